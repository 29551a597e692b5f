from __future__ import annotations

from pathlib import Path

import pytest

from tests.ingest import vendor_files as vendor
from tests.ingest.images import texture, with_databar
from tests.ingest.metadata.reading import read


@pytest.mark.parametrize(
    ("tag", "code"),
    [(vendor.zeiss(), vendor.ZEISS), (vendor.fei(height=160, databar=0), vendor.FEI_HELIOS)],
    ids=["zeiss", "fei"],
)
def test_a_resized_image_has_larger_pixels_and_says_so(
    tmp_path: Path, tag: bytes, code: int
) -> None:
    path = vendor.write_tiff(tmp_path / "a.tif", texture(0)[::2, ::2], {code: tag})
    reading = read(path)
    assert reading.metadata.pixel_size_um == pytest.approx(0.05)
    assert "resizing" in " ".join(reading.warnings)


def test_a_resized_fei_image_with_its_databar_is_recognised(tmp_path: Path) -> None:
    image = with_databar(texture(0))[::2, ::2]
    path = vendor.write_tiff(tmp_path / "a.tif", image, {vendor.FEI_HELIOS: vendor.fei()})
    assert read(path).metadata.pixel_size_um == pytest.approx(0.05)


@pytest.mark.parametrize(
    ("tag", "code"),
    [(vendor.zeiss(), vendor.ZEISS), (vendor.fei(height=160, databar=0), vendor.FEI_HELIOS)],
    ids=["zeiss", "fei"],
)
def test_an_image_turned_by_a_viewer_keeps_its_pixels_and_says_so(
    tmp_path: Path, tag: bytes, code: int
) -> None:
    path = vendor.write_tiff(tmp_path / "a.tif", texture(0).T, {code: tag})
    reading = read(path)
    assert reading.metadata.pixel_size_um == pytest.approx(0.025)
    assert "90 degrees" in " ".join(reading.warnings)


def test_a_cropped_image_keeps_its_pixels_and_says_so(tmp_path: Path) -> None:
    path = vendor.write_tiff(
        tmp_path / "a.tif", texture(0)[:90, :150], {vendor.ZEISS: vendor.zeiss()}
    )
    reading = read(path)
    assert reading.metadata.pixel_size_um == pytest.approx(0.025)
    assert "cropped" in " ".join(reading.warnings)


def test_a_pixel_size_that_contradicts_the_field_width_is_noticed(tmp_path: Path) -> None:
    tag = vendor.zeiss(pixel_nm=12.5, store=None)  # twice too small for 5 um over 200 px
    reading = read(vendor.write_tiff(tmp_path / "a.tif", texture(0), {vendor.ZEISS: tag}))
    assert reading.metadata.pixel_size_um == pytest.approx(0.025)
    assert "AP_WIDTH" in " ".join(reading.warnings)
