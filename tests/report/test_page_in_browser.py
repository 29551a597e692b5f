"""The page as a browser shows it: nothing leaves it, nothing is cut, with scripts and without."""

import pytest

from tests.browser import FLAGS, chromium, opened
from tests.report.soundness import SETTLE_MS, WIDER, check_sound, own_complaints, violations

pytestmark = pytest.mark.slow

WIDTHS = (1400, 900, 400)


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
@pytest.mark.parametrize("width", WIDTHS)
def test_the_page_is_sound_on_every_screen(full_page, width, dark):
    with opened(full_page, width=width, height=900, dark=dark) as watched:
        check_sound(watched, full_page, width=width, dark=dark)


def test_without_scripts_images_figures_and_tables_are_there(full_page):
    from playwright.sync_api import sync_playwright

    program = chromium()
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=list(FLAGS))
        page = browser.new_context(java_script_enabled=False).new_page()
        page.goto(full_page)
        assert page.locator("#strip img").count() == 7
        assert not page.locator("#panel").is_visible()
        assert page.get_by_text("need JavaScript").is_visible()
        assert page.locator("#figures img").count() > 10
        assert page.locator("#images table").is_visible()
        browser.close()


def test_paper_has_light_colours_and_no_controls(full_page):
    with opened(full_page, width=794, height=1123, dark=True) as watched:
        page = watched.page
        page.emulate_media(media="print")
        page.wait_for_timeout(SETTLE_MS)
        assert page.evaluate("getComputedStyle(document.body).backgroundColor") == (
            "rgb(255, 255, 255)"
        )
        assert not page.locator("nav").is_visible()
        assert not page.locator("#before").is_visible()
        assert page.locator("#stack").is_visible()
        assert page.evaluate(WIDER) == []


def test_the_page_of_a_real_project_is_sound(small_project):
    address = (small_project / "report" / "report.html").as_uri()
    with opened(address, width=1400, height=900) as watched:
        watched.page.wait_for_timeout(SETTLE_MS)
        assert violations(watched.page) == []
        assert own_complaints(watched) == []
        assert watched.requests == [address]
        assert watched.page.locator("#panel").is_visible()
