from __future__ import annotations

import shutil
from dataclasses import asdict
from math import radians
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import DATA
from tests.ingest import vendor_files as vendor
from tests.ingest.images import save, texture
from tests.ingest.metadata.reading import read


@pytest.mark.data
@pytest.mark.skipif(not DATA.is_dir(), reason="needs the development data")
def test_a_tescan_sidecar_says_the_same_as_the_tag(tmp_path: Path) -> None:
    folder = DATA / "sem_metadata"
    by_tag = read(folder / "tescan-pfib_dataZeroed.tif")
    path = save(tmp_path / "a.tif", np.zeros((1578, 1280), np.uint16))
    shutil.copyfile(folder / "tescan-pfib_dataZeroed.hdr", tmp_path / "a.hdr")
    by_file = read(path)
    left, right = asdict(by_tag.metadata), asdict(by_file.metadata)
    left.pop("source")
    assert right.pop("source")["tilt_rad"] == "a.hdr [SEM] StageTilt"
    assert left == right


@pytest.mark.parametrize("name", ["a.hdr", "a-tif.hdr", "a.HDR"])
def test_tescan_sidecars_are_found_under_their_names(tmp_path: Path, name: str) -> None:
    path = save(tmp_path / "a.tif", texture(0))
    (tmp_path / name).write_text(vendor.tescan_hdr())
    assert read(path).metadata.tilt_rad == pytest.approx(radians(30))


def test_any_other_text_beside_an_image_is_left_alone(tmp_path: Path) -> None:
    path = save(tmp_path / "a.png", texture(0))
    (tmp_path / "a.txt").write_text("notes: 5 kV, tilt = 30\n[section]\nPixelSize=3\n")
    reading = read(path)
    assert (reading.vendor, reading.warnings) == ("", ())
    assert reading.metadata.pixel_size_um is None
