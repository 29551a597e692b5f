from __future__ import annotations

import shutil
from dataclasses import asdict
from math import radians
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from semsfm_colmap.ingest.files.raster import read_header
from semsfm_colmap.ingest.metadata import MetadataReading, read_metadata
from semsfm_colmap.ingest.metadata.text import (
    decode,
    flag,
    length_um,
    number,
    number_and_unit,
    read_sections,
)
from semsfm_colmap.ingest.metadata.xml import flatten_xml
from tests.ingest import vendor_files as vendor
from tests.ingest.conftest import DATA, save, texture, with_databar


def read(path: Path) -> MetadataReading:
    return read_metadata(path, read_header(path, 10**9))


SAMPLES: dict[str, dict[str, Any]] = {
    "fei_helios_16bit.tif": {
        "pixel_size_um": 3.3724,  # [EScan] PixelWidth=3.3724e-006
        "tilt_rad": 6.54498e-06,  # [Stage] StageT, radians
        "stage_rotation_rad": -2.3611,
        "scan_rotation_rad": 0.0,
        "stage_xyz_um": (25.76, -194.177, 7965.0),
        "working_distance_um": 4034.66,  # WD=0.00403466
        "beam_energy_kev": 5.0,  # HV=5000
        "magnification": 119.99977,  # MagCanvasRealWidth=0.20720 / HFW=0.00172667; bar says 120 x
        "instrument": 'Helios NanoLab" 660',
        "detector": "ETD",
        "tilt_corrected": False,
    },
    "quanta_image.tif": {
        "pixel_size_um": 0.441942,
        "tilt_rad": 0.0121551,
        "stage_rotation_rad": 0.0010584,
        "scan_rotation_rad": 0.0,
        "stage_xyz_um": (9654.0, 14600.8, 11000.0),
        "working_distance_um": 11051.0,
        "beam_energy_kev": 30.0,
        "magnification": 282.84292,  # MagCanvasRealWidth=0.12800 / HFW=0.000452548
        "instrument": "Quanta FEG",
        "detector": "LFD",
        "tilt_corrected": False,
    },
    "quad1image_001_no_beam_scan_or_system_meta.tif": {
        "pixel_size_um": 0.441942,
        "tilt_rad": 0.0121551,
        "stage_rotation_rad": 0.0010584,
        "scan_rotation_rad": 0.0,
        "stage_xyz_um": (9654.0, 14600.8, 11000.0),
        "working_distance_um": 11051.0,
        "beam_energy_kev": 30.0,
        "magnification": 282.84292,
        "instrument": None,  # no [System]
        "detector": None,  # no [Detectors]
        "tilt_corrected": False,
    },
    "scios_xml_metadata.tif": {
        "pixel_size_um": 0.0269792,
        "tilt_rad": -1.44393e-05,
        "stage_rotation_rad": 2.74789,
        "scan_rotation_rad": 0.0,
        "stage_xyz_um": (-19849.7, 10592.6, 6999.58),
        "working_distance_um": 6984.62,
        "beam_energy_kev": 5.0,
        "magnification": None,  # MagCanvasRealWidth is empty
        "instrument": "Scios 2",
        "detector": "CBS",
        "tilt_corrected": False,
    },
    "tescan-pfib_dataZeroed.tif": {
        "pixel_size_um": 0.0015625,  # PixelSizeX=0.0000000015625
        "tilt_rad": 0.0,
        "stage_rotation_rad": radians(30.0),  # StageRotation=30.0, degrees
        "scan_rotation_rad": 0.0,
        "stage_xyz_um": (4072.93, 16073.298, 6311.907),
        "working_distance_um": 5947.501,
        "beam_energy_kev": 15.0,
        "magnification": 160000.0,
        "instrument": "TESCAN AMBER X",
        "detector": "E-T",
        "tilt_corrected": False,
    },
    "zeiss_512pix.tif": {
        # 4th number 5.824988e-009 m on a display of 1024 px; AP_WIDTH = 5.965 um / 512 agrees.
        "pixel_size_um": 5.824988e-3 * 1024 / 512,
        "tilt_rad": 0.0,
        "stage_rotation_rad": radians(245.8),
        "scan_rotation_rad": None,
        "stage_xyz_um": (62996.1, 65316.8, 44678.0),
        "working_distance_um": 3900.0,
        "beam_energy_kev": 5.0,
        "magnification": 50000.0,
        "instrument": "ULTRA 55-36-06",
        "detector": "InLens",
        "tilt_corrected": None,
    },
}


@pytest.mark.data
@pytest.mark.skipif(not DATA.is_dir(), reason="needs the development data")
@pytest.mark.parametrize("name", SAMPLES)
def test_real_headers_give_the_values_read_off_by_hand(name: str) -> None:
    reading = read(DATA / "sem_metadata" / name)
    values = asdict(reading.metadata)
    source = values.pop("source")
    for field, expected in SAMPLES[name].items():
        value = values.pop(field)
        if isinstance(expected, float | tuple):
            assert value == pytest.approx(expected, rel=1e-6, abs=1e-12), field
        else:
            assert value == expected, field
        assert (field in source) == (value is not None), field
    assert values == {"displacement_um": None}  # no microscope knows it


def fei_sources(tag: str, beam: str = "[Beam]") -> dict[str, str]:
    return {
        "pixel_size_um": f"{tag} [EScan] PixelWidth",
        "tilt_rad": f"{tag} [Stage] StageT",
        "stage_rotation_rad": f"{tag} [Stage] StageR",
        "scan_rotation_rad": f"{tag} {beam} ScanRotation",
        "stage_xyz_um": f"{tag} [Stage] StageX, Y, Z",
        "working_distance_um": f"{tag} [EBeam] WD",
        "beam_energy_kev": f"{tag} [EBeam] HV",
        "magnification": f"{tag} [Image] MagCanvasRealWidth / {tag} [EBeam] HFW",
        "instrument": f"{tag} [System] SystemType",
        "detector": f"{tag} [Detectors] Name",
        "tilt_corrected": f"{tag} [EBeam] TiltCorrectionIsOn",
    }


SOURCES: dict[str, dict[str, str]] = {
    "fei_helios_16bit.tif": fei_sources("FEI 34682"),
    "quanta_image.tif": fei_sources("FEI 34682"),
    "quad1image_001_no_beam_scan_or_system_meta.tif": fei_sources(
        "FEI text outside its tag", "[EBeam]"
    ),
    "scios_xml_metadata.tif": fei_sources("FEI 34682"),
    "tescan-pfib_dataZeroed.tif": {
        "pixel_size_um": "TESCAN 50431 [MAIN] PixelSizeX",
        "tilt_rad": "TESCAN 50431 [SEM] StageTilt",
        "stage_rotation_rad": "TESCAN 50431 [SEM] StageRotation",
        "scan_rotation_rad": "TESCAN 50431 [SEM] ScanRotation",
        "stage_xyz_um": "TESCAN 50431 [SEM] StageX, Y, Z",
        "working_distance_um": "TESCAN 50431 [SEM] WD",
        "beam_energy_kev": "TESCAN 50431 [SEM] HV",
        "magnification": "TESCAN 50431 [MAIN] Magnification",
        "instrument": "TESCAN 50431 [MAIN] Device",
        "detector": "TESCAN 50431 [SEM] Detector",
        "tilt_corrected": "TESCAN 50431 [SEM] TiltCorrection",
    },
    "zeiss_512pix.tif": {
        "pixel_size_um": "CZ_SEM 4th number x 1024 / image width",
        "tilt_rad": "CZ_SEM AP_STAGE_AT_T",
        "stage_rotation_rad": "CZ_SEM AP_STAGE_AT_R",
        "stage_xyz_um": "CZ_SEM AP_STAGE_AT_X, _Y, _Z",
        "working_distance_um": "CZ_SEM AP_WD",
        "beam_energy_kev": "CZ_SEM AP_ACTUALKV",
        "magnification": "CZ_SEM AP_MAG",
        "instrument": "CZ_SEM SV_SERIAL_NUMBER",
        "detector": "CZ_SEM DP_DETECTOR_CHANNEL",
    },
}
SHAPES = {
    "fei_helios_16bit.tif": (512, 471, 16, "FEI"),
    "quanta_image.tif": (1024, 943, 8, "FEI"),
    "quad1image_001_no_beam_scan_or_system_meta.tif": (1024, 831, 8, "FEI"),
    "scios_xml_metadata.tif": (1536, 1024, 8, "FEI"),
    "tescan-pfib_dataZeroed.tif": (1280, 1578, 16, "TESCAN"),
    "zeiss_512pix.tif": (512, 384, 8, "Zeiss"),
}
"""Width, height, bits, whose header; the heights include the databar."""


@pytest.mark.data
@pytest.mark.skipif(not DATA.is_dir(), reason="needs the development data")
@pytest.mark.parametrize("name", SAMPLES)
def test_every_value_names_the_field_it_comes_from(name: str) -> None:
    path = DATA / "sem_metadata" / name
    reading = read(path)
    known = {field for field, value in SAMPLES[name].items() if value is not None}
    assert dict(reading.metadata.source) == {k: v for k, v in SOURCES[name].items() if k in known}
    header = read_header(path, 10**9)
    assert (header.width, header.height, header.bits, reading.vendor) == SHAPES[name]
    assert (header.channels, header.orientation) == (1, 1)


@pytest.mark.data
@pytest.mark.skipif(not DATA.is_dir(), reason="needs the development data")
def test_every_real_file_is_asserted() -> None:
    names = {path.name for path in (DATA / "sem_metadata").glob("*.tif")}
    assert names == set(SAMPLES) == set(SOURCES) == set(SHAPES)


@pytest.mark.data
@pytest.mark.skipif(not DATA.is_dir(), reason="needs the development data")
def test_real_headers_tell_the_rows_of_the_image_and_what_is_missing() -> None:
    folder = DATA / "sem_metadata"
    readings = {name: read(folder / name) for name in SAMPLES}
    assert readings["fei_helios_16bit.tif"].image_rows == 442
    assert readings["quanta_image.tif"].image_rows == 884
    assert readings["tescan-pfib_dataZeroed.tif"].databar_rows == 298
    damaged = " ".join(readings["quad1image_001_no_beam_scan_or_system_meta.tif"].warnings)
    assert "records no instrument, detector" in damaged
    assert "directory is damaged" in damaged
    assert "dynamic focus" in " ".join(readings["scios_xml_metadata.tif"].warnings)
    for name in set(SAMPLES) - {
        "quad1image_001_no_beam_scan_or_system_meta.tif",
        "scios_xml_metadata.tif",
    }:
        assert readings[name].warnings == ()


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


@pytest.mark.data
@pytest.mark.skipif(not DATA.is_dir(), reason="needs the development data")
def test_fei_xml_alone_gives_the_same_as_the_text_beside_it(tmp_path: Path) -> None:
    import tifffile

    source = DATA / "sem_metadata/scios_xml_metadata.tif"
    with tifffile.TiffFile(source) as tiff:
        xml = str(tiff.pages[0].tags[34683].value).encode()
    path = vendor.write_tiff(
        tmp_path / "a.tif", np.zeros((1024, 1536), np.uint8), {vendor.FEI_XML: xml}
    )
    by_text, by_xml = asdict(read(source).metadata), asdict(read(path).metadata)
    assert by_xml["source"]["tilt_rad"] == "FEI 34683 StageSettings/StagePosition/Tilt/Alpha"
    for field in set(by_text) - {"source", "magnification"}:
        expected = by_text[field]
        if isinstance(expected, float | tuple):
            assert by_xml[field] == pytest.approx(expected, rel=1e-4), field
        else:
            assert by_xml[field] == expected, field


# Units of every vendor: the same microscope settings written in each vendor's own units.


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


def test_fei_angles_are_radians_and_lengths_metres(tmp_path: Path) -> None:
    image = with_databar(texture(0))
    path = vendor.write_tiff(tmp_path / "a.tif", image, {vendor.FEI_HELIOS: vendor.fei()})
    reading = read(path)
    known = reading.metadata
    assert known.pixel_size_um == pytest.approx(0.025)
    assert known.tilt_rad == 0.5
    assert known.working_distance_um == pytest.approx(11051)
    assert known.beam_energy_kev == 30
    assert reading.image_rows == 136
    assert reading.warnings == ()


def test_an_fei_tilt_in_degrees_is_refused_not_believed(tmp_path: Path) -> None:
    tag = vendor.fei(tilt_rad=52.0)
    reading = read(vendor.write_tiff(tmp_path / "a.tif", texture(0), {vendor.FEI_HELIOS: tag}))
    assert reading.metadata.tilt_rad is None
    assert "no angle in radians" in " ".join(reading.warnings)


@pytest.mark.parametrize(
    ("dropped", "missing"),
    [
        (("System",), "instrument"),
        (("Detectors",), "detector"),
        (("Scan", "EScan", "EBeam", "Beam"), "pixel size, working distance, beam energy"),
        (("Stage", "EBeam"), "stage tilt"),
    ],
)
def test_sections_missing_from_an_fei_header_are_named(
    tmp_path: Path, dropped: tuple[str, ...], missing: str
) -> None:
    tag = vendor.fei(drop=dropped)
    path = vendor.write_tiff(tmp_path / "a.tif", with_databar(texture(0)), {vendor.FEI_SFEG: tag})
    said = " ".join(read(path).warnings)
    assert "the FEI header records no " in said
    for words in missing.split(", "):
        if words == "working distance":
            continue  # still in [Stage]
        assert words in said


def test_the_beam_without_its_own_section_is_the_electron_beam(tmp_path: Path) -> None:
    tag = vendor.fei(drop=("Beam", "Scan"))
    path = vendor.write_tiff(tmp_path / "a.tif", with_databar(texture(0)), {vendor.FEI_HELIOS: tag})
    known = read(path).metadata
    assert known.pixel_size_um == pytest.approx(0.025)
    assert known.source["scan_rotation_rad"] == "FEI 34682 [EBeam] ScanRotation"


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


@pytest.mark.parametrize("name", ["a.hdr", "a-tif.hdr", "a.HDR"])
def test_tescan_sidecars_are_found_under_their_names(tmp_path: Path, name: str) -> None:
    path = save(tmp_path / "a.tif", texture(0))
    (tmp_path / name).write_text(vendor.tescan_hdr())
    assert read(path).metadata.tilt_rad == pytest.approx(radians(30))


def test_a_damaged_tescan_chain_is_read_from_its_text(tmp_path: Path) -> None:
    tag = b"\xff\xff\xff\xff" + vendor.tescan_tag()[4:]
    path = vendor.write_tiff(tmp_path / "a.tif", texture(0), {vendor.TESCAN: tag})
    known = read(path).metadata
    assert known.pixel_size_um == pytest.approx(0.025)
    assert known.tilt_rad == pytest.approx(radians(30))


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


def test_any_other_text_beside_an_image_is_left_alone(tmp_path: Path) -> None:
    path = save(tmp_path / "a.png", texture(0))
    (tmp_path / "a.txt").write_text("notes: 5 kV, tilt = 30\n[section]\nPixelSize=3\n")
    reading = read(path)
    assert (reading.vendor, reading.warnings) == ("", ())
    assert reading.metadata.pixel_size_um is None


# Re-saved files: the pixel size must be that of the stored image.


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


@pytest.mark.parametrize(
    ("code", "tag"),
    [
        (vendor.FEI_HELIOS, vendor.fei(tilt_correction="yes")),
        (vendor.TESCAN, vendor.tescan_tag(tilt_correction=30.0)),
        (vendor.ZEISS, vendor.zeiss(more="DP_TILT_CORRECTION\r\nTilt Corrn. = On\r\n")),
    ],
    ids=["fei", "tescan", "zeiss"],
)
def test_tilt_correction_is_detected_and_warned_of(tmp_path: Path, code: int, tag: bytes) -> None:
    reading = read(vendor.write_tiff(tmp_path / "a.tif", texture(0), {code: tag}))
    assert reading.metadata.tilt_corrected is True
    assert "tilt correction was on" in " ".join(reading.warnings)


# Texts.


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("5.825 nm", 5.825), ("2.11e-009", 2.11e-9), (" -3 ", -3.0), ("3,5", 3.5), (".5", 0.5),
        ("nan", None), ("inf", None), ("1e999", None), ("", None), (None, None), ("x 5", None),
        ("9" * 50, None), ("1e15", 1e15), ("0x10", 0.0),
    ],
)  # fmt: skip
def test_numbers_are_read_and_absurd_ones_refused(text: str | None, value: float | None) -> None:
    assert number(text) == value


@pytest.mark.parametrize(
    ("text", "um"),
    [("8.5 mm", 8500), ("5.825 nm", 5.825e-3), ("3 \u00b5m", 3), ("3\u03bcm", 3), ("1 m", 1e6),
     ("2 \u00c5", 2e-4), ("500 pm", 5e-4), ("5 furlong", None), ("5", None)],
)  # fmt: skip
def test_lengths_need_a_known_unit(text: str, um: float | None) -> None:
    assert length_um(text) == (pytest.approx(um) if um is not None else None)


def test_units_are_lower_case_and_separate() -> None:
    assert number_and_unit("50.00 K X") == (50.0, "k x")
    assert flag("Yes") is True
    assert flag("off") is False
    assert flag("maybe") is None


def test_sections_take_any_line_ending_and_the_first_of_equal_keys() -> None:
    for end in ("\n", "\r\n", "\r"):
        sections = read_sections(
            end.join(["a=0", "[S]", "k = 1", "k=2", "[T]", "no equals", "x=y=z"])
        )
        assert sections == {"": {"a": "0"}, "S": {"k": "1"}, "T": {"x": "y=z"}}


def test_text_after_padding_zeros_is_ignored_and_bytes_never_fail() -> None:
    assert decode(b"abc\x00\x00\x00\x00rubbish") == "abc"
    assert decode(bytes(range(256))) != ""


def test_xml_is_flattened_without_its_root() -> None:
    values, problem = flatten_xml("<?xml version='1.0'?><M><A><B> 1 </B><B>2</B></A><C/></M>")
    assert (values, problem) == ({"A/B": "1"}, None)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ('<!DOCTYPE l [<!ENTITY a "aaaa">]><l>&a;</l>', "document type"),
        ("<a>" * 40 + "</a>" * 40, "levels"),
        ("<r>" + "<a/>" * 30_000 + "</r>", "elements"),
        ("<a><b></a>", "well-formed"),
        ("", "well-formed"),
    ],
    ids=["entities", "deep", "many", "broken", "empty"],
)
def test_hostile_xml_is_refused_with_a_reason(text: str, reason: str) -> None:
    values, problem = flatten_xml(text)
    assert values == {}
    assert problem is not None
    assert reason in problem
