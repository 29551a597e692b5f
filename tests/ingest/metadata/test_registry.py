from __future__ import annotations

from dataclasses import asdict
from math import radians
from pathlib import Path
from typing import Any

import pytest

from semsfm_colmap.ingest.files.raster import read_header
from tests.conftest import DATA
from tests.ingest import vendor_files as vendor
from tests.ingest.images import texture
from tests.ingest.metadata.reading import read

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
    # no microscope knows these
    assert values == {"displacement_um": None, "tilt_axis_rad": None}


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
