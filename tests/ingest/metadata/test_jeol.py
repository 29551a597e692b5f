from __future__ import annotations

from math import radians
from pathlib import Path

import pytest

from tests.ingest import vendor_files as vendor
from tests.ingest.images import save, texture, with_databar
from tests.ingest.metadata.reading import read

JEOL_NAMED = "$CM_STAGE_POSITION X=37.1761, Y=44.9344, R=354.9968, Z=16.90, T=12.50"


JEOL_LISTED = "$CM_STAGE_POS 37.1761 44.9344 16.90 354.9968 12.5 0"


JEOL_BAR = "$$SM_MICRON_BAR 80\r\n$$SM_MICRON_MARKER 2\u00b5m"


JEOL_FIELD = "$CM_FIELD_OF_VIEW 5.000\u00b5m 3.400\u00b5m\r\n$CM_PIXEL_SIZE 25nm"


@pytest.mark.parametrize("stage", [JEOL_NAMED, JEOL_LISTED], ids=["named", "listed"])
@pytest.mark.parametrize("scale", [JEOL_BAR, JEOL_FIELD], ids=["bar", "field"])
@pytest.mark.parametrize("encoding", ["utf-8", "cp1252", "cp932"])
def test_jeol_text_gives_degrees_millimetres_and_the_pixel_size(
    tmp_path: Path, stage: str, scale: str, encoding: str
) -> None:
    path = save(tmp_path / "a.tif", with_databar(texture(0)))
    text = vendor.jeol(stage=stage, scale=scale)
    if encoding == "cp932":
        text = text.replace("\u00b5", "\u03bc")  # the Japanese code page has only the letter mu
    (tmp_path / "a.txt").write_bytes(text.encode(encoding))
    reading = read(path)
    known = reading.metadata
    assert known.pixel_size_um == pytest.approx(0.025)
    assert known.tilt_rad == pytest.approx(radians(12.5))
    assert known.stage_rotation_rad == pytest.approx(radians(354.9968))
    assert known.stage_xyz_um == pytest.approx((37176.1, 44934.4, 16900.0))
    assert known.scan_rotation_rad == pytest.approx(radians(10))
    assert known.working_distance_um == pytest.approx(10200)
    assert known.beam_energy_kev == 15
    assert (known.instrument, known.detector) == ("JSM-7001F", "SEI")
    assert reading.image_rows == 136


def test_jeol_lines_in_the_description_of_a_tiff_are_read(tmp_path: Path) -> None:
    text = vendor.jeol(stage=JEOL_NAMED, scale=JEOL_BAR).replace("\u00b5", "u")
    path = save(tmp_path / "a.tif", texture(0), description=text, metadata=None)
    known = read(path).metadata
    assert known.tilt_rad == pytest.approx(radians(12.5))
    assert known.source["tilt_rad"].startswith("ImageDescription $CM_STAGE_POSITION")
