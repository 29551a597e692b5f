from __future__ import annotations

from math import radians
from pathlib import Path

from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.ingest.prepare import prepare_series
from tests.ingest import vendor_files as vendor
from tests.ingest.images import save, texture, with_databar
from tests.ingest.prepared import prepare


def test_what_is_odd_about_single_images_is_said_once_for_all_of_them(good: Path) -> None:
    for i in range(5):
        save(good / "x.png", texture(20 + i)).rename(good / f"odd{i}.tif")
    said = [w for w in prepare(good).warnings if "the content is PNG" in w]
    assert said == [
        "odd0.tif, odd1.tif, odd2.tif and 2 more: the content is PNG, not what the suffix says."
    ]


def test_changing_scan_rotation_and_tilt_correction_are_said(folder: Path, tmp_path: Path) -> None:
    for i in range(3):
        tag = vendor.fei(
            scan_rotation_rad=radians(10.0 * (i == 1)), tilt_correction="yes" if i == 2 else "no"
        )
        vendor.write_tiff(folder / f"{i}.tif", with_databar(texture(i)), {vendor.FEI_HELIOS: tag})
    series = prepare_series(folder, tmp_path / "p", IngestOptions())
    said = " ".join(series.warnings)
    assert "the scan rotation changes within the series (from 0.0 to 10.0 degrees)" in said
    assert "2.tif: tilt correction was on here but not in the other images." in said
