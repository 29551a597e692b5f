"""A browser without a window, for tests of pages: marked `slow`, and skipped where none is."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
FLAGS = (
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
)


@dataclass
class Watched:
    """A page, and what it did that a test may want to know."""

    page: Any
    complaints: list[str] = field(default_factory=list)
    """errors and warnings of the console, and exceptions"""
    requests: list[str] = field(default_factory=list)
    """addresses that it asked for, ``data:`` and ``blob:`` left out"""


def chromium() -> str:
    """The browser's program; the test is skipped where there is none."""
    pytest.importorskip("playwright.sync_api")
    found = next((path for name in NAMES if (path := shutil.which(name))), None)
    if found is None:
        pytest.skip("there is no Chromium")
    return found


@contextmanager
def opened(
    address: str, *, width: int = 1000, height: int = 800, dark: bool = False
) -> Iterator[Watched]:
    """An address in a browser of its own.

    Scripts are run by `page.evaluate`; `page.wait_for_function` needs eval, which the pages forbid.
    """
    program = chromium()
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=list(FLAGS))
        scheme: Any = "dark" if dark else "light"
        page = browser.new_page(
            viewport={"width": width, "height": height},
            color_scheme=scheme,
            accept_downloads=True,
        )
        watched = Watched(page=page)
        page.on("console", lambda m: _note(watched, m))
        page.on("pageerror", lambda error: watched.complaints.append(str(error)))
        page.on("request", lambda request: _ask(watched, request.url))
        try:
            page.goto(address)
            yield watched
        finally:
            browser.close()


def _note(watched: Watched, message: Any) -> None:
    # of the software renderer, not of the page
    own = "GPU stall due to ReadPixels" in message.text
    if message.type in ("error", "warning") and not own:
        watched.complaints.append(message.text)


def _ask(watched: Watched, url: str) -> None:
    if not url.startswith(("data:", "blob:")):
        watched.requests.append(url)
