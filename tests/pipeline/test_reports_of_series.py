"""The reports of real and rendered series, as a browser shows them."""

from __future__ import annotations

from pathlib import Path

import pytest

import semsfm_colmap
from tests.browser import chromium, opened
from tests.report.soundness import check_sound

pytestmark = [pytest.mark.slow, pytest.mark.data]

MAX_PAGE_BYTES = 15e6
SERIES = {
    "sem_pot1": "sem_pot1",
    "sem_quartz3": "sem_quartz3",
    "nickel": "synth_nickel/images",
    "pollen": "synth_pollen/images",
    "spore": "synth_spore/images",
}
MAX_NUM_IMAGES = 5
"""Of a long series its beginning is looked at."""
SCREENS = [(1400, False), (400, True)]
ENDINGS = (".jpg", ".png", ".tif")
SWITCHES = "#images input[type=checkbox], #images input[type=radio], #pairs input"
USED = """(selector) => {
  let count = 0;
  for (const e of document.querySelectorAll(selector)) {
    if (!e.disabled) { e.click(); count += 1; }
  }
  return count;
}"""


@pytest.fixture(scope="module", params=SERIES)
def address(
    request: pytest.FixtureRequest, data_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> str:
    """Of the report of a series, reconstructed for a quick look."""
    chromium()
    folder = tmp_path_factory.mktemp(request.param)
    project, images = folder / "p", folder / "images"
    images.mkdir()
    some = [p for p in sorted((data_path / SERIES[request.param]).iterdir()) if p.suffix in ENDINGS]
    for path in some[:MAX_NUM_IMAGES]:
        (images / path.name).symlink_to(path.resolve())
    semsfm_colmap.reconstruct(images, project, semsfm_colmap.preset("low"))
    page = project / "report" / "report.html"
    assert page.stat().st_size < MAX_PAGE_BYTES
    return page.resolve().as_uri()


@pytest.mark.parametrize(("width", "dark"), SCREENS)
def test_the_report_of_a_series_is_sound_on_every_screen(
    address: str, width: int, dark: bool
) -> None:
    with opened(address, width=width, height=900, dark=dark) as watched:
        watched.page.wait_for_selector("#viewer.drawn", timeout=60_000)
        check_sound(watched, address, width=width, dark=dark)


def test_every_switch_of_the_images_and_pairs_works_without_complaint(address: str) -> None:
    with opened(address, width=1200, height=900) as watched:
        page = watched.page
        page.wait_for_selector("#viewer.drawn", timeout=60_000)
        assert page.evaluate(USED, SWITCHES) > 8
        page.get_by_role("button", name="next", exact=True).click()
        page.get_by_role("button", name="next pair").click()
        page.wait_for_timeout(500)
        assert page.evaluate(USED, "#viewer input[type=checkbox]") >= 3
        for name in ("from behind", "from above", "oblique"):
            page.get_by_role("button", name=name).click()
        page.wait_for_timeout(500)
        assert watched.complaints == []
        assert watched.requests == [address]
