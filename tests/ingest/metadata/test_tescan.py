from __future__ import annotations

from math import radians
from pathlib import Path

import pytest

from tests.ingest import vendor_files as vendor
from tests.ingest.images import texture, with_databar
from tests.ingest.metadata.reading import read


def test_tescan_angles_are_degrees_and_lengths_metres(tmp_path: Path) -> None:
    image = with_databar(texture(0))
    path = vendor.write_tiff(tmp_path / "a.tif", image, {vendor.TESCAN: vendor.tescan_tag()})
    reading = read(path)
    known = reading.metadata
    assert known.pixel_size_um == pytest.approx(0.025)
    assert known.tilt_rad == pytest.approx(radians(30))
    assert known.stage_rotation_rad == pytest.approx(radians(30))
    assert known.working_distance_um == pytest.approx(5947.501)
    assert known.beam_energy_kev == 15
    assert known.detector == "SE"
    assert reading.databar_rows == 24
    assert reading.warnings == ()


def test_a_damaged_tescan_chain_is_read_from_its_text(tmp_path: Path) -> None:
    tag = b"\xff\xff\xff\xff" + vendor.tescan_tag()[4:]
    path = vendor.write_tiff(tmp_path / "a.tif", texture(0), {vendor.TESCAN: tag})
    known = read(path).metadata
    assert known.pixel_size_um == pytest.approx(0.025)
    assert known.tilt_rad == pytest.approx(radians(30))
