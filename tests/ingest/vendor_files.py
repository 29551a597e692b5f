"""Files as the vendors write them, with values to choose: also where no sample is at hand.

The layouts follow public descriptions and readers: Zeiss and FEI as in tifffile and NexusLIMS,
TESCAN's records as in its own files, Hitachi's ``[SemImageFile]`` and JEOL's ``$CM_`` lines as in
the readers of pynxtools-em, Bio-Formats and ImageJ macros.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import tifffile

ZEISS, FEI_SFEG, FEI_HELIOS, FEI_XML, TESCAN = 34118, 34680, 34682, 34683, 50431


def write_tiff(path: Path, image: np.ndarray, tags: dict[int, bytes], **options: Any) -> Path:
    """A TIFF with private tags of text."""
    extra = [(code, 1 if code == TESCAN else 2, len(raw), raw, True) for code, raw in tags.items()]
    tifffile.imwrite(path, image, extratags=extra, metadata=None, **options)
    return path


def zeiss(
    *,
    pixel_nm: float | None = 25.0,
    display_nm: float | None = None,
    width_um: float | None = 5.0,
    height_um: float | None = 4.0,
    store: str | None = "200 * 160",
    tilt: str = "30.0 \u00b0",
    more: str = "",
) -> bytes:
    """Text of tag 34118; without the unnamed numbers at the start."""
    lines = ["", "0", "0", "0", "DP_DETECTOR_CHANNEL", "Signal A = SE2", "DP_SEM", "SEM = SUPRA 40"]
    pairs: list[tuple[str, str]] = [
        ("AP_WD", "WD =  8.5 mm"),
        ("AP_MAG", "Mag =   4.57 K X"),
        ("AP_ACTUALKV", "EHT =  3.00 kV"),
        ("AP_STAGE_AT_T", f"Stage at T = {tilt}"),
        ("AP_STAGE_AT_R", "Stage at R = 190.0 \u00b0"),
        ("AP_STAGE_AT_X", "Stage at X = 62.9961 mm"),
        ("AP_STAGE_AT_Y", "Stage at Y = 65.3168 mm"),
        ("AP_STAGE_AT_Z", "Stage at Z = 44.678 mm"),
        ("AP_DATE", "Date :25 Sep 2018"),
    ]
    if pixel_nm is not None:
        pairs.append(("AP_IMAGE_PIXEL_SIZE", f"Image Pixel Size = {pixel_nm:.4g} nm"))
    if display_nm is not None:
        pairs.append(("AP_PIXEL_SIZE", f"Pixel Size = {display_nm:.4g} nm"))
    if width_um is not None:
        pairs.append(("AP_WIDTH", f"Width = {width_um:.4g} \u00b5m"))
    if height_um is not None:
        pairs.append(("AP_HEIGHT", f"Height = {height_um:.4g} \u00b5m"))
    if store is not None:
        pairs.append(("DP_IMAGE_STORE", f"Store resolution = {store}"))
    for key, line in pairs:
        lines += [key, line]
    return ("\r\n".join(lines) + "\r\n" + more).encode("cp1252")


def fei(
    *,
    pixel_m: float = 2.5e-8,
    width: int = 200,
    height: int = 136,
    databar: int = 24,
    tilt_rad: float = 0.5,
    scan_rotation_rad: float = 0.0,
    tilt_correction: str = "no",
    drop: tuple[str, ...] = (),
) -> bytes:
    """Text of tag 34682; `drop` names sections to leave out."""
    hfw, vfw = pixel_m * width, pixel_m * height
    sections = {
        "User": {"Date": "06/13/2016", "User": "supervisor"},
        "System": {"Type": "SEM", "SystemType": "Quanta FEG"},
        "Beam": {"HV": "30000", "ScanRotation": scan_rotation_rad, "Beam": "EBeam",
                 "Scan": "EScan"},
        "EBeam": {
            "HV": "30000", "HFW": hfw, "VFW": vfw, "WD": "0.011051",
            "TiltCorrectionIsOn": tilt_correction, "DynamicFocusIsOn": "no",
            "ScanRotation": scan_rotation_rad, "StageX": "0.009654", "StageY": "0.0146008",
            "StageZ": "0.011", "StageR": "0.0010584", "StageTa": tilt_rad,
        },
        "Scan": {"PixelWidth": pixel_m, "PixelHeight": pixel_m, "HorFieldsize": hfw,
                 "VerFieldsize": vfw},
        "EScan": {"PixelWidth": pixel_m, "PixelHeight": pixel_m, "HorFieldsize": hfw,
                  "VerFieldsize": vfw},
        "Stage": {"StageX": "0.009654", "StageY": "0.0146008", "StageZ": "0.011",
                  "StageR": "0.0010584", "StageT": tilt_rad, "WorkingDistance": "0.011051"},
        "Image": {"ResolutionX": width, "ResolutionY": height, "MagCanvasRealWidth": "0.12800"},
        "Detectors": {"Number": "1", "Name": "LFD", "Mode": "SE"},
        "PrivateFei": {"DatabarHeight": databar},
    }  # fmt: skip
    blocks = [
        f"[{name}]\r\n" + "".join(f"{key}={value}\r\n" for key, value in values.items())
        for name, values in sections.items()
        if name not in drop
    ]
    return "\r\n".join(blocks).encode()


def tescan_sections(
    *,
    pixel_m: float = 2.5e-8,
    width: int = 200,
    strip: int = 24,
    tilt_deg: float = 30.0,
    tilt_correction: float = 0.0,
) -> tuple[str, str]:
    """Texts of [MAIN] and [SEM]."""
    magnification = 10_000.0
    main = {
        "AccFrames": 1, "Date": "2025-12-03", "Device": "VEGA3 TESCAN", "ImageStripSize": strip,
        "Magnification": magnification, "MagnificationReference": pixel_m * width * magnification,
        "PixelSizeX": f"{pixel_m:.13f}", "PixelSizeY": f"{pixel_m:.13f}",
    }  # fmt: skip
    sem = {
        "AcceleratorVoltage": 15000.0, "Detector": "SE", "HV": 15000.0, "ScanRotation": 0.0,
        "StageRotation": 30.0, "StageTilt": tilt_deg, "StageX": 0.00407293, "StageY": 0.016073298,
        "StageZ": 0.006311907, "TiltCorrection": tilt_correction, "WD": 0.005947501,
    }  # fmt: skip
    return (
        "".join(f"{key}={value}\n" for key, value in main.items()),
        "".join(f"{key}={value}\n" for key, value in sem.items()),
    )


def tescan_tag(**values: Any) -> bytes:
    """Bytes of tag 50431: records of a thumbnail and the two sections."""
    main, sem = tescan_sections(**values)

    def record(kind: int, content: bytes) -> bytes:
        return struct.pack("<IH", len(content) + 2, kind) + content

    return (
        record(1, b"\x00\x00\x00\x0cjP  \r\n" + bytes(64))
        + record(2, main.encode() + b"\x00")
        + record(3, sem.encode() + b"\x00")
        + record(0, b"")
    )


def tescan_hdr(**values: Any) -> str:
    """Text of a .hdr file."""
    main, sem = tescan_sections(**values)
    return f"[MAIN]\n{main}\n[SEM]\n{sem}"


def hitachi(
    *, pixel_nm: float = 24.80469, size: str = "200x160", tilt: str = "0", marker_nm: str = "2000"
) -> str:
    """Text of the .txt file of an S-4800 and its relatives."""
    return "\r\n".join(
        [
            "[SemImageFile]", "InstructName=S-4800", "SerialNumber=1234-05", "SampleName=grain",
            "Format=tif", "ImageName=a.tif", "Date=05/28/2008", "Time=16:31:44",
            f"DataSize={size}", f"PixelSize={pixel_nm}", "SignalName=SE(M)",
            "AcceleratingVoltage=5000 Volt", "DecelerationVoltage=0 Volt", "Magnification=4000",
            "WorkingDistance=8700 um", "EmissionCurrent=10100 nA", "LensMode=High",
            f"MicronMarker={marker_nm}", "ScanSpeed=Slow4", "ColorMode=Grayscale",
            "StageType=2", "StagePositionX=40523500", "StagePositionY=38240000",
            "StagePositionR=0", "StagePositionZ=8000000", f"StagePositionT={tilt}", "",
        ]
    )  # fmt: skip


def jeol(*, stage: str, scale: str, size: str = "200 136") -> str:
    """Text of the .txt file of a JSM."""
    return "\r\n".join(
        [
            "$SEM_DATA_VERSION 1", "$CM_LABEL JEOL", "$CM_FORMAT JEOL/EO", "$CM_VERSION 1.0",
            "$CM_DATE 2019/03/07", "$CM_INSTRUMENT JSM-7001F", "$CM_ACCEL_VOLT 15.00",
            "$CM_MAG 5000", "$CM_SIGNAL SEI", f"$CM_FULL_SIZE {size}", stage, scale,
            "$$SM_WD 10.2", "$$SM_SCAN_ROTATION 10.00", "",
        ]
    )  # fmt: skip
