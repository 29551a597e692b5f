"""The check of the documentation lets no broken link through."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.docs.blocks import ROOT


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """The repository with a docs/ of its own."""
    for path in ROOT.iterdir():
        if path.name not in ("docs", "build", ".git"):
            (tmp_path / path.name).symlink_to(path)
    shutil.copytree(ROOT / "docs", tmp_path / "docs")
    return tmp_path


def check(folder: Path) -> subprocess.CompletedProcess[str]:
    """Run the piece of the check that builds the site."""
    return subprocess.run(
        ["bash", str(folder / "scripts" / "check.sh"), "docs"],
        capture_output=True,
        text=True,
        env={**os.environ, "SEMSFM_VENV": sys.prefix, "PYTHONPATH": str(ROOT)},
    )


@pytest.mark.slow
def test_a_link_or_an_anchor_that_leads_nowhere_fails_the_check(copy: Path) -> None:
    page = copy / "docs" / "plan.md"
    text = page.read_text(encoding="utf-8")
    page.write_text(f"{text}\n[a](nowhere.md) [b](truth.md#nowhere)\n", encoding="utf-8")
    done = check(copy)
    assert done.returncode != 0
    assert "'nowhere.md'" in done.stdout
    assert "'#nowhere'" in done.stdout
    # and nothing else does
    assert "Aborted with 2 warnings" in done.stdout
