"""Headers of other programs and microscopes, in small files of their layout."""

from __future__ import annotations

import base64
import json
from math import radians
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile

from semsfm_colmap.ingest.frame.source import scan_image
from semsfm_colmap.ingest.options import IngestOptions
from tests.ingest import vendor_files as vendor
from tests.ingest.images import save, texture
from tests.ingest.metadata.reading import read

SIZE_UM = 0.15625


@pytest.mark.parametrize(
    ("unit", "um"),
    [("um", 1), ("nm", 1e-3), ("mm", 1e3), ("cm", 1e4), ("micron", 1), ("inch", 25400),
     ("\\u00B5m", 1), ("\u00b5m", 1)],
)  # fmt: skip
def test_imagej_gives_the_pixel_size_in_any_unit(tmp_path: Path, unit: str, um: float) -> None:
    path = tmp_path / "a.tif"
    for order in "<>":
        tifffile.imwrite(
            path, texture(0), description=f"ImageJ=1.54f\nunit={unit}\n".encode(),
            resolution=(um / SIZE_UM, um / SIZE_UM), metadata=None, byteorder=order,
        )  # fmt: skip
        reading = read(path)
        assert reading.metadata.pixel_size_um == pytest.approx(SIZE_UM, rel=1e-4)
        assert reading.warnings == ()


def test_imagej_without_a_unit_or_in_pixels_gives_none(tmp_path: Path) -> None:
    for unit in ("", "unit=pixel\n"):
        path = tmp_path / "a.tif"
        description = f"ImageJ=1.54f\n{unit}"
        tifffile.imwrite(
            path, texture(0), description=description, resolution=(4, 4), metadata=None
        )
        assert read(path).metadata.pixel_size_um is None


@pytest.mark.parametrize(("unit", "factor"), [("\u00b5m", 1.0), ("nm", 1e3), ("mm", 1e-3)])
def test_ome_xml_gives_the_pixel_size(tmp_path: Path, unit: str, factor: float) -> None:
    path = tmp_path / "a.ome.tif"
    size = SIZE_UM * factor
    metadata = {"PhysicalSizeX": size, "PhysicalSizeXUnit": unit, "axes": "YX"}
    tifffile.imwrite(path, texture(0), ome=True, metadata=metadata)
    assert read(path).metadata.pixel_size_um == pytest.approx(SIZE_UM)


@pytest.mark.parametrize(
    ("resolution", "unit", "um"),
    [(1e4 / SIZE_UM, "CENTIMETER", SIZE_UM), (25400 / SIZE_UM, "INCH", SIZE_UM),
     (72, "INCH", None), (300, "INCH", None), (1200, "INCH", None), (2400, "INCH", None),
     (300 / 2.54, "CENTIMETER", None), (6400, "NONE", None)],
)  # fmt: skip
def test_resolution_tags_count_unless_they_are_a_printers(
    tmp_path: Path, resolution: float, unit: str, um: float | None
) -> None:
    path = tmp_path / "a.tif"
    tifffile.imwrite(
        path, texture(0), resolution=(resolution, resolution), resolutionunit=unit, metadata=None
    )
    found = read(path).metadata.pixel_size_um
    assert found == (None if um is None else pytest.approx(um, rel=1e-4))


def test_digital_micrograph_gives_the_pixel_size(tmp_path: Path) -> None:
    path = tmp_path / "a.tif"
    tags = [(65003, 2, 3, "nm", True), (65009, 12, 1, 156.25, True)]
    tifffile.imwrite(path, texture(0), extratags=tags, metadata=None)
    assert read(path).metadata.pixel_size_um == pytest.approx(SIZE_UM)


def jeol_lines(*lines: str) -> str:
    start = ("$CM_LABEL JEOL", "$CM_INSTRUMENT 4700F", "$CM_FULL_SIZE 200 160")
    return "\r\n".join((*start, *lines))


@pytest.mark.parametrize(
    "lines",
    [("$CM_MAG 4096",), ("$CM_FIELD_OF_VIEW 31.25 25.0 um",), ("$CM_FIELD_OF_VIEW 31.25um 25um",)],
)
def test_jeol_is_read_by_magnification_and_with_one_unit(tmp_path: Path, lines: tuple[str]) -> None:
    path = save(tmp_path / "a.tif", texture(0))
    (tmp_path / "a.txt").write_text(jeol_lines(*lines))
    assert read(path).metadata.pixel_size_um == pytest.approx(SIZE_UM)  # 128 mm / 4096 / 200


@pytest.mark.parametrize("suffix", [".Txt", ".tXT", ".TXT"])
def test_a_text_file_beside_the_image_is_found_in_any_case(tmp_path: Path, suffix: str) -> None:
    path = save(tmp_path / "a.tif", texture(0))
    (tmp_path / f"a{suffix}").write_text(jeol_lines("$CM_MAG 4096"))
    assert read(path).metadata.pixel_size_um == pytest.approx(SIZE_UM)


def phenom_xml(unit: str, size: float) -> bytes:
    return (
        '<?xml version="1.0" encoding="utf-8"?><FeiImage><databarHeight>0</databarHeight>'
        f'<pixelWidth unit="{unit}">{size}</pixelWidth><pixelHeight unit="{unit}">{size}'
        "</pixelHeight><instrument><type>SEM</type><edition>Phenom ProX</edition></instrument>"
        '<acquisition><scan><highVoltage unit="kV">15</highVoltage><detector>BSD</detector></scan>'
        '</acquisition><workingDistance unit="mm">6.5</workingDistance></FeiImage>'
    ).encode()


@pytest.mark.parametrize(("unit", "size"), [("nm", 156.25), ("um", 0.15625)])
def test_phenom_is_read_from_its_tag_and_behind_a_jpeg(
    tmp_path: Path, unit: str, size: float
) -> None:
    xml = phenom_xml(unit, size)
    tiff = vendor.write_tiff(tmp_path / "a.tif", texture(0), {vendor.FEI_XML: xml})
    jpeg = save(tmp_path / "a.jpg", texture(0))
    jpeg.write_bytes(jpeg.read_bytes() + xml)
    for path in (tiff, jpeg):
        metadata = read(path).metadata
        assert metadata.pixel_size_um == pytest.approx(SIZE_UM)
        assert (metadata.beam_energy_kev, metadata.detector) == (15.0, "BSD")
        assert metadata.working_distance_um == pytest.approx(6500)
        assert metadata.instrument == "Phenom ProX"


def test_openfibsem_is_in_metres_and_radians(tmp_path: Path) -> None:
    path = tmp_path / "a.tif"
    content = {
        "image": {"beam_type": "ELECTRON", "resolution": [200, 160], "hfw": 31.25e-6},
        "pixel_size": {"x": SIZE_UM * 1e-6, "y": SIZE_UM * 1e-6},
        "microscope_state": {
            "stage_position": {"x": 1e-3, "y": 0.0, "z": 0.0, "r": 0.5, "t": -0.25},
            "electron_beam": {"working_distance": 0.004, "voltage": 2000, "scan_rotation": 0.1},
        },
        "system": {"info": {"manufacturer": "Demo", "model": "DemoMicroscope"}},
    }
    tifffile.imwrite(path, texture(0), description=json.dumps(content), metadata=None)
    metadata = read(path).metadata
    assert metadata.pixel_size_um == pytest.approx(SIZE_UM)
    assert (metadata.tilt_rad, metadata.stage_rotation_rad) == (-0.25, 0.5)
    assert metadata.scan_rotation_rad == pytest.approx(0.1)
    assert metadata.beam_energy_kev == 2.0
    assert metadata.stage_xyz_um == (1000.0, 0.0, 0.0)
    for broken in ({"image": 3, "pixel_size": []}, {"image": {}, "pixel_size": {"x": "1"}}):
        tifffile.imwrite(path, texture(0), description=json.dumps(broken), metadata=None)
        assert read(path).metadata.pixel_size_um is None


def test_fibics_gives_pixel_size_and_stage(tmp_path: Path) -> None:
    xml = (
        b'<?xml version="1.0"?><Fibics version="1.2"><Image><Width>200</Width><Height>160</Height>'
        b'</Image><Scan><FOV_X units="um">31.25</FOV_X><FOV_Y units="um">25</FOV_Y>'
        b'<ScanRot units="deg">5</ScanRot></Scan><Stage><Tilt units="deg">-10</Tilt>'
        b'<Rot units="deg">20</Rot></Stage></Fibics>'
    )
    path = vendor.write_tiff(tmp_path / "a.tif", texture(0), {51023: xml})
    metadata = read(path).metadata
    assert metadata.pixel_size_um == pytest.approx(SIZE_UM)
    assert metadata.tilt_rad == pytest.approx(radians(-10))
    assert metadata.stage_rotation_rad == pytest.approx(radians(20))
    assert metadata.scan_rotation_rad == pytest.approx(radians(5))


def memento_item(key: str, inner: str) -> str:
    head = f"<item><key><string>{key}</string></key>"
    return f"{head}<value><MementoItem>{inner}</MementoItem></value></item>"


def memento_number(key: str, value: float) -> str:
    return memento_item(key, f"<Name>{key}</Name><anyType d:type='q1:double'>{value!r}</anyType>")


def memento(tilt_rad: float) -> bytes:
    size = memento_item("PixelSize", memento_number("Width", 1.5625e-7))
    items = memento_item("Scan", size) + memento_item("Stage", memento_number("T", tilt_rad))
    xml = f"<MementoItemCollection>{items}</MementoItemCollection>"
    return base64.b64encode(b"\xef\xbb\xbf" + xml.encode())


def test_base64_of_memento_xml_is_read_or_said(tmp_path: Path) -> None:
    path = tmp_path / "a.tif"
    vendor.write_tiff(path, texture(0), {vendor.FEI_SFEG: memento(-0.2)})
    metadata = read(path).metadata
    assert metadata.pixel_size_um == pytest.approx(SIZE_UM)
    assert metadata.tilt_rad == pytest.approx(-0.2)
    other = base64.b64encode(b"<MementoItemCollection>" + 60 * b" " + b"</MementoItemCollection>")
    vendor.write_tiff(path, texture(0), {vendor.FEI_SFEG: other})
    reading = read(path)
    assert reading.metadata.pixel_size_um is None
    assert "holds nothing that is known" in " ".join(reading.warnings)


def test_zeiss_dynamic_focus_is_warned_of_by_the_key_of_real_files(tmp_path: Path) -> None:
    tag = vendor.zeiss(more="DP_DYNFOCUS\r\nDyn.Focus = On\r\n")
    path = vendor.write_tiff(tmp_path / "a.tif", texture(0), {vendor.ZEISS: tag})
    assert "dynamic focus was on" in " ".join(read(path).warnings)


def test_tescan_images_of_the_ion_beam_have_a_block_of_their_own(tmp_path: Path) -> None:
    path = save(tmp_path / "a.tif", texture(0))
    text = vendor.tescan_hdr(tilt_deg=55.0).replace("[SEM]", "[FIB]")
    (tmp_path / "a.hdr").write_text(text)
    metadata = read(path).metadata
    assert metadata.tilt_rad == pytest.approx(radians(55.0))
    assert metadata.source["tilt_rad"] == "a.hdr [FIB] StageTilt"


def test_a_reduced_fei_image_with_its_databar_has_larger_pixels(tmp_path: Path) -> None:
    whole = np.array(texture(0), order="C")
    whole[136:] = 0
    cv2.putText(whole, "HV 30 kV  WD 11 mm", (10, 155), cv2.FONT_HERSHEY_SIMPLEX, 0.45, 255, 1)
    half = np.rint(whole.reshape(80, 2, 100, 2).mean(axis=(1, 3))).astype(np.uint8)
    tag = vendor.fei(databar=0)  # recorded for 200 x 136 px of 25 nm, as if there were no databar
    path = vendor.write_tiff(tmp_path / "a.tif", half, {vendor.FEI_HELIOS: tag})
    image, _ = scan_image(path, "a.tif", IngestOptions())
    assert image.databar_row == 68
    assert image.reading.metadata.pixel_size_um == pytest.approx(0.05)
    assert "as after resizing" in " ".join(image.warnings)
