"""What every report must be in a browser."""

from __future__ import annotations

from typing import Any

from tests.browser import Watched

SETTLE_MS = 600
SERIOUS = {"serious", "critical"}
WIDER = """() => {
  const scrolls = ".table, .view, .strip, .skip, .scene";
  return Array.from(document.querySelectorAll("body *"))
    .filter((e) => !e.closest(scrolls) || e.matches(scrolls) && !e.matches(".skip"))
    .filter((e) => e.getBoundingClientRect().right > innerWidth + 1)
    .map((e) => e.tagName + "#" + e.id + "." + e.className);
}"""


def own_complaints(watched: Watched) -> list[str]:
    return [c for c in watched.complaints if "willReadFrequently" not in c]


def violations(page: Any) -> list[tuple[str, list[str]]]:
    from axe_playwright_python.sync_playwright import Axe

    found = Axe().run(page).response["violations"]
    return [
        (v["id"], [node["html"][:120] for node in v["nodes"][:3]])
        for v in found
        if v["impact"] in SERIOUS
    ]


def check_sound(watched: Watched, address: str, *, width: int, dark: bool) -> None:
    """Nothing leaves the page or is cut, nothing complains, everybody can use it, its colours."""
    page = watched.page
    page.wait_for_timeout(SETTLE_MS)
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert page.evaluate(WIDER) == []
    assert violations(page) == []
    assert own_complaints(watched) == []
    assert watched.requests == [address]
    ground = page.evaluate("getComputedStyle(document.body).backgroundColor")
    brightness = sum(int(v) for v in ground.strip("rgb()").split(","))
    assert (brightness < 200) == dark
