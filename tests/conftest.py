from __future__ import annotations

from pathlib import Path

import pytest

DATA = Path(__file__).parents[1] / ".." / "shared" / "data"


@pytest.fixture(scope="session")
def data_path() -> Path:
    """The development data beside the repository; tests that need it are marked `data`."""
    if not DATA.is_dir():
        pytest.skip("the development data are not there")
    return DATA
