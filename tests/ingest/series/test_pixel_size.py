from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from semsfm_colmap.errors import InputError
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.ingest.prepare import prepare_series
from tests.ingest import vendor_files as vendor
from tests.ingest.images import save, texture, with_databar
from tests.ingest.prepared import prepare

OPTIONS = IngestOptions()


def magnified(folder: Path, sizes_um: list[float]) -> Path:
    for i, um in enumerate(sizes_um):
        tag = vendor.fei(pixel_m=um * 1e-6)
        vendor.write_tiff(folder / f"{i}.tif", with_databar(texture(i)), {vendor.FEI_HELIOS: tag})
    return folder


def test_another_magnification_is_left_out_in_one_sentence(folder: Path) -> None:
    series = prepare(magnified(folder, [0.05, 0.025, 0.025, 0.0251, 0.1]))
    assert series.names == ("1.tif", "2.tif", "3.tif")
    assert series.pixel_size_um == pytest.approx(0.025)
    about = [w for w in series.warnings if "magnification" in w]
    assert about == [
        "0.tif, 4.tif: a pixel size of 0.05 to 0.1 um is recorded, but 0.025 um for most images, "
        "and views of another magnification cannot be placed; give pixel_size_um or a table if "
        "that is wrong. Left out."
    ]


def test_a_slightly_other_magnification_goes_on_with_one_sentence(folder: Path) -> None:
    series = prepare(magnified(folder, [0.0253, 0.025, 0.025, 0.025]))
    assert len(series.names) == 4
    (about,) = [w for w in series.warnings if "magnification" in w]
    assert about.startswith("0.tif: the recorded pixel size differs")


def test_the_user_s_pixel_size_keeps_images_whose_headers_disagree(folder: Path) -> None:
    options = replace(OPTIONS, pixel_size_um=0.025)
    assert len(prepare(magnified(folder, [0.05, 0.025, 0.025]), options).names) == 3


def test_three_magnifications_in_three_images_are_refused(folder: Path) -> None:
    with pytest.raises(InputError, match=r"only 1 of 3 images .* another magnification"):
        prepare(magnified(folder, [0.1, 0.05, 0.025]))


def test_the_pixel_size_option_wins_and_the_contradiction_is_said(
    fei_series: Path, tmp_path: Path
) -> None:
    series = prepare_series(fei_series, tmp_path / "p", IngestOptions(pixel_size_um=0.03))
    assert (series.pixel_size_um, series.pixel_size_source) == (0.03, "option pixel_size_um")
    assert "pixel_size_um = 0.03 is used although the files say 0.025." in series.warnings
    assert series.frames[0].metadata.pixel_size_um == pytest.approx(0.025)


def test_images_without_pixel_size_among_others_are_named(fei_series: Path, tmp_path: Path) -> None:
    save(fei_series / "plain.tif", with_databar(texture(9)))
    series = prepare_series(fei_series, tmp_path / "p", IngestOptions())
    assert series.pixel_size_um == pytest.approx(0.025)
    assert any(w.startswith("plain.tif: no pixel size recorded") for w in series.warnings)
