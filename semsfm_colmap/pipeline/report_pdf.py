"""The report as PDF, printed by a browser that is installed: it draws the page as it is shown."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from pathlib import Path

from semsfm_colmap.errors import InputError, MissingDependencyError
from semsfm_colmap.io.atomic import file_aside

BROWSERS = (
    "chromium",
    "chromium-browser",
    "google-chrome",
    "google-chrome-stable",
    "chrome",
    "microsoft-edge",
    "microsoft-edge-stable",
    "msedge",
)
"""Programs on the PATH that print without a window, all of one kind; the first that is there."""
SETTLE_MS = 20_000
"""Of the page's own time: its scripts draw within it, and it passes as fast as they do."""
TIMEOUT_S = 300


def find_browser() -> str | None:
    """The path of an installed browser that prints; None where there is none."""
    return next((found for name in BROWSERS if (found := shutil.which(name))), None)


def write_pdf(page_path: Path, pdf_path: Path) -> None:
    """Print a page that lies on this disk, aside, then renamed.

    Raises
    ------
    MissingDependencyError
        where no such browser is installed
    InputError
        where the browser prints nothing

    """
    browser = find_browser()
    if browser is None:
        raise MissingDependencyError(
            "a PDF needs Chromium, Chrome or Edge on the PATH, and none is installed: install one, "
            f"or open {page_path} in any browser and print it"
        )
    with tempfile.TemporaryDirectory(prefix="semsfm-") as profile, file_aside(pdf_path) as aside:
        command = [
            browser,
            "--headless",
            "--disable-gpu",
            "--disable-background-networking",
            "--no-first-run",
            "--no-pdf-header-footer",
            f"--user-data-dir={profile}",
            f"--virtual-time-budget={SETTLE_MS}",
            f"--print-to-pdf={aside.resolve()}",
            page_path.resolve().as_uri(),
        ]
        if hasattr(os, "geteuid") and os.geteuid() == 0:
            # its sandbox does not run as root
            command.insert(1, "--no-sandbox")
        try:
            done = subprocess.run(
                command, capture_output=True, text=True, errors="replace", timeout=TIMEOUT_S
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            raise InputError(f"{browser} did not print {page_path}: {error}") from error
        if not aside.is_file() or not aside.read_bytes().startswith(b"%PDF"):
            said = (done.stderr.strip() or f"exit code {done.returncode}").splitlines()[-1]
            raise InputError(f"{browser} did not print {page_path}: {said}")
