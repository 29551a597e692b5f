from __future__ import annotations

from math import radians
from pathlib import Path

import numpy as np
import pytest

from tests.ingest import vendor_files as vendor
from tests.ingest.images import texture
from tests.ingest.metadata.reading import read


def test_zeiss_angles_are_degrees_and_lengths_carry_units(tmp_path: Path) -> None:
    path = vendor.write_tiff(tmp_path / "a.tif", texture(0), {vendor.ZEISS: vendor.zeiss()})
    known = read(path).metadata
    assert known.pixel_size_um == pytest.approx(0.025)
    assert known.tilt_rad == pytest.approx(radians(30))
    assert known.stage_rotation_rad == pytest.approx(radians(190))
    assert known.stage_xyz_um == pytest.approx((62996.1, 65316.8, 44678.0))
    assert known.working_distance_um == pytest.approx(8500)
    assert known.beam_energy_kev == pytest.approx(3.0)
    assert known.magnification == pytest.approx(4570)
    assert (known.instrument, known.detector) == ("SUPRA 40", "SE2")


def test_zeiss_display_pixels_are_not_taken_for_stored_ones(tmp_path: Path) -> None:
    # 2048 px stored from a field of 5 um: 2.441 nm per stored pixel, 4.883 nm on the display.
    tag = vendor.zeiss(
        pixel_nm=None, display_nm=4.883, width_um=5.0, height_um=3.75, store="2048 * 1536"
    )
    image = np.tile(texture(0, 64, 64), (24, 32))
    reading = read(vendor.write_tiff(tmp_path / "a.tif", image, {vendor.ZEISS: tag}))
    assert reading.metadata.pixel_size_um == pytest.approx(5.0 / 2048)
    without_width = vendor.zeiss(pixel_nm=None, display_nm=4.883, width_um=None, store=None)
    reading = read(vendor.write_tiff(tmp_path / "b.tif", image, {vendor.ZEISS: without_width}))
    assert reading.metadata.pixel_size_um == pytest.approx(4.883e-3 / 2, rel=1e-3)
