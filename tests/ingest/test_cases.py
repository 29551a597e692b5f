"""The small inputs that once came out wrong, each with its right answer."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from semsfm_colmap.ingest.inspect.inspection import Inspection, inspect_images
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.motion.stage import stage_rotations
from tests.conftest import DATA
from tests.ingest.images import pixels_of

CASES = DATA.parent / "cases"
SIZE_UM = 0.15625
TILTS = [-10.0, -5.0, 0.0, 5.0, 10.0]
pytestmark = [
    pytest.mark.data,
    pytest.mark.skipif(not CASES.is_dir(), reason="needs the development data"),
]


def inspected(name: str, **options: float) -> Inspection:
    return inspect_images(CASES / name, IngestOptions(**options))


def said(inspection: Inspection) -> str:
    return " ".join([*inspection.remarks, *(w for row in inspection.rows for w in row.warnings)])


@pytest.mark.parametrize(
    ("name", "size_um", "tilts"),
    [
        ("02_ruler_hitachi", SIZE_UM, None),
        ("03_imagej_um", SIZE_UM, None),
        ("03b_ome", SIZE_UM, None),
        ("04_jeol_magnification_only", SIZE_UM, TILTS),
        ("05b_sidecar_case", SIZE_UM, TILTS),
        ("06_phenom_xml", SIZE_UM, None),
        ("07_openfibsem", SIZE_UM, TILTS),
        ("09_fibics_atlas", SIZE_UM, TILTS),
        ("15_mrc_and_mdoc", SIZE_UM, TILTS),
        ("15_mrc_and_mdoc/series.mrc", SIZE_UM, TILTS),
        ("16_fei_resized", 2 * SIZE_UM, TILTS),
        ("17_fei_sfeg_base64", SIZE_UM, TILTS),
    ],
)
def test_pixel_sizes_and_tilts_are_right(
    name: str, size_um: float, tilts: list[float] | None
) -> None:
    rows = inspected(name).rows
    assert len(rows) == (3 if name == "02_ruler_hitachi" else 5)
    assert [row.pixel_size_um for row in rows] == pytest.approx([size_um] * len(rows), rel=0.01)
    if tilts is not None:
        assert [row.tilt_deg for row in rows] == pytest.approx(tilts, abs=1e-3)


@pytest.mark.parametrize("name", ["01_stack_in_one_file", "01_stack_in_one_file/tilt_series.tif"])
def test_a_stack_in_one_file_has_five_views(name: str) -> None:
    inspection = inspected(name)
    assert len(inspection.rows) == 5
    assert next(a.answer for a in inspection.answers if a.question == "enough images") == "yes"


def test_a_bar_over_the_image_gives_the_scale() -> None:
    rows = inspected("02c_bar_over_image", scale_bar_um=10).rows
    assert [row.pixel_size_um for row in rows] == pytest.approx([10 / 64] * 5)


def test_dynamic_focus_and_changing_scan_rotation_are_said() -> None:
    assert "dynamic focus was on" in said(inspected("08_zeiss_dynamic_focus"))
    assert "from -40.0 to 40.0 degrees" in said(inspected("19_scan_rotation_varies"))


def test_tilt_and_rotation_together_turn_by_31_6_degrees() -> None:
    inspection = inspected("10_tilt_and_rotation")
    tilt = np.deg2rad([row.tilt_deg for row in inspection.rows])
    R = stage_rotations(tilt, np.deg2rad([row.stage_rotation_deg for row in inspection.rows]))
    cosine = (np.einsum("aij,bij->ab", R, R) - 1) / 2
    assert np.rad2deg(np.arccos(cosine.min())) == pytest.approx(31.6, abs=0.05)
    assert any("up to 31.6 degrees" in a.reason for a in inspection.answers)


@pytest.mark.parametrize("name", ["11_copy_without_header_wins", "12_tif_and_jpeg_twins"])
def test_one_of_each_twin_is_used(name: str) -> None:
    rows = inspected(name).rows
    left_out = [row.name for row in rows if any("of f" in w or "as f" in w for w in row.warnings)]
    assert left_out == [row.name for row in rows if not row.name.endswith(".tif")]
    assert len(left_out) == 5


def test_inks_are_not_inverted_and_other_formats_are_read() -> None:
    inks = pixels_of(CASES / "14_cmyk/f0.tif")
    grey = pixels_of(CASES / "03_imagej_um/f0.tif")
    assert np.corrcoef(inks.ravel(), grey.ravel())[0, 1] > 0.99
    assert len([r for r in inspected("15b_unsupported_beside_supported").rows if r.width]) == 5
    assert (CASES / Path("15b_unsupported_beside_supported/f3.jp2")).is_file()
