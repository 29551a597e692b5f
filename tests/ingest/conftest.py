from __future__ import annotations

from pathlib import Path

import pytest

from tests.ingest import vendor_files as vendor
from tests.ingest.images import save, texture, with_databar


@pytest.fixture
def good(folder: Path) -> Path:
    """Three images that are in order."""
    for i in range(3):
        save(folder / f"good{i}.png", texture(i))
    return folder


@pytest.fixture
def fei_series(folder: Path) -> Path:
    """Four images with FEI headers that say 0.5 rad and 25 nm."""
    for i in range(4):
        image = with_databar(texture(i))
        vendor.write_tiff(folder / f"{i}.tif", image, {vendor.FEI_HELIOS: vendor.fei()})
    return folder
