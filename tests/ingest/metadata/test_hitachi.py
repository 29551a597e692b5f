from __future__ import annotations

from math import radians
from pathlib import Path

import pytest

from tests.ingest import vendor_files as vendor
from tests.ingest.images import save, texture
from tests.ingest.metadata.reading import read


def test_hitachi_text_gives_nanometres_volts_and_the_scale_bar(tmp_path: Path) -> None:
    path = save(tmp_path / "a.tif", texture(0))
    (tmp_path / "a.txt").write_text(vendor.hitachi(), encoding="cp1252")
    reading = read(path)
    known = reading.metadata
    assert known.pixel_size_um == pytest.approx(0.02480469)
    assert known.working_distance_um == 8700
    assert known.beam_energy_kev == 5
    assert known.magnification == 4000
    assert known.stage_xyz_um == pytest.approx((40523.5, 38240.0, 8000.0))
    assert (known.instrument, known.detector) == ("S-4800", "SE(M)")
    assert known.tilt_rad == 0.0
    assert reading.scale_bar_um == 2.0


def test_a_hitachi_text_in_utf16_is_read_too(tmp_path: Path) -> None:
    path = save(tmp_path / "a.bmp", texture(0))
    (tmp_path / "a.txt").write_text(vendor.hitachi(), encoding="utf-16")
    assert read(path).metadata.pixel_size_um == pytest.approx(0.02480469)


def test_a_hitachi_tilt_without_unit_is_not_used(tmp_path: Path) -> None:
    path = save(tmp_path / "a.tif", texture(0))
    (tmp_path / "a.txt").write_text(vendor.hitachi(tilt="30000"))
    reading = read(path)
    assert reading.metadata.tilt_rad is None
    assert "StagePositionT=30000 has no unit" in " ".join(reading.warnings)
    (tmp_path / "a.txt").write_text(vendor.hitachi(tilt="12.5 deg"))
    assert read(path).metadata.tilt_rad == pytest.approx(radians(12.5))
