"""Fuzz what reads foreign headers: no crash, no hang, no memory beyond a bound, no absurd value.

    python scripts/fuzz_headers.py --target all --seconds 600 --data ../shared/data/sem_metadata

Coverage-guided by atheris (libFuzzer) where it is installed, else by plain mutation. The corpus
starts from the headers of the files in --data and from small ones in here. A finding is written to
--findings and ends the run of its target with exit code 1; it belongs into
tests/ingest/metadata/test_fuzz.py.
"""

from __future__ import annotations

import argparse
import base64
import json
import math
import os
import random
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any

MEMORY_MB = 2048
SECONDS_PER_INPUT = 10
MAX_INPUT = 1 << 16
MAX_PIXELS = 1 << 20
MAX_WARNING = 2000
MAX_TABLE_CELL = 10**6


def check_reading(reading: Any) -> None:
    """What must hold of any metadata, whatever the header says."""
    known = asdict(reading.metadata)
    source = known.pop("source")
    for name, value in known.items():
        for number in value if isinstance(value, tuple) else (value,):
            if isinstance(number, float):
                assert math.isfinite(number), (name, number)
        if value is not None:
            assert name in source, name
    for name in ("pixel_size_um", "working_distance_um", "beam_energy_kev", "magnification"):
        assert known[name] is None or known[name] > 0, (name, known[name])
    for name in ("tilt_rad", "stage_rotation_rad", "scan_rotation_rad"):
        assert known[name] is None or abs(known[name]) <= 4 * math.pi, (name, known[name])
    assert reading.image_rows is None or reading.image_rows > 0
    assert reading.scale_bar_um is None or reading.scale_bar_um > 0
    for warning in reading.warnings:
        check_sentence(warning)
    json.dumps(known, allow_nan=False).encode("utf-8")
    json.dumps(source, ensure_ascii=False).encode("utf-8", "backslashreplace")


def check_sentence(text: str) -> None:
    """A warning is one line of sane length."""
    assert "\n" not in text, text[:80]
    assert "\r" not in text, text[:80]
    assert len(text) <= MAX_WARNING, len(text)


def fuzz_tags(code: int) -> Callable[[bytes], None]:
    """A target that hands bytes to the reader of one TIFF tag."""

    def target(data: bytes) -> None:
        from semsfm_colmap.ingest.metadata.registry import read_tags

        reading = read_tags({code: data}, header(data))
        if reading is not None:
            check_reading(reading)

    return target


def fuzz_memento(data: bytes) -> None:
    """Bytes as the XML in base64 of tag 34680."""
    fuzz_tags(34680)(base64.b64encode(data))


def fuzz_calibration(data: bytes) -> None:
    """Bytes as description, resolution and DigitalMicrograph's scale."""
    from semsfm_colmap.ingest.metadata import calibration

    start, rest = data[:8], data[8:]
    for description in (rest, b"ImageJ=1\n" + rest, b"<OME" + rest):
        tags = {270: description, 282: start, 296: data[:2], 65009: start, 65003: rest[:4]}
        reading = calibration.read(tags, header(data))
        if reading is not None:
            check_reading(reading)


def fuzz_sidecar(data: bytes) -> None:
    """Bytes as the text file beside an image."""
    from semsfm_colmap.ingest.metadata.sidecar import read_sidecar

    with tempfile.TemporaryDirectory(dir=scratch()) as folder:
        Path(folder, "a.txt").write_bytes(data)
        reading = read_sidecar(Path(folder, "a.tif"), header(data))
    if reading is not None:
        check_reading(reading)


def fuzz_file(data: bytes) -> None:
    """Bytes as an image file: header, metadata and pixels."""
    from semsfm_colmap.ingest.files.header import UnreadableImageError
    from semsfm_colmap.ingest.files.raster import read_header, read_pixels
    from semsfm_colmap.ingest.metadata import read_metadata

    with tempfile.TemporaryDirectory(dir=scratch()) as folder:
        path = Path(folder, "a.tif")
        path.write_bytes(data)
        try:
            found = read_header(path, MAX_PIXELS)
            check_reading(read_metadata(path, found))
            raw = read_pixels(path, found)
        except UnreadableImageError as error:
            check_sentence(str(error))
            return
        assert raw.pixels.ndim == 2
        assert raw.pixels.size <= MAX_PIXELS


def fuzz_table(data: bytes) -> None:
    """Bytes as a series table."""
    from semsfm_colmap.errors import SemSfmError
    from semsfm_colmap.ingest.series.table import read_series_table

    with tempfile.TemporaryDirectory(dir=scratch()) as folder:
        path = Path(folder, "s.csv")
        path.write_bytes(data)
        try:
            table = read_series_table(path)
        except SemSfmError as error:
            check_sentence(str(error))
            return
    table.match(["a.tif", "b/c.png"])
    for row in table.rows:
        for value in (row.tilt_deg, row.rotation_deg, row.displacement_um, row.pixel_size_um):
            assert value is None or math.isfinite(value)


def fuzz_stack(data: bytes) -> None:
    """Bytes as an MRC stack: header, metadata and pixels of two sections."""
    from semsfm_colmap.errors import InputError
    from semsfm_colmap.ingest.files.listing import find_images
    from semsfm_colmap.ingest.files.raster import read_header, read_pixels
    from semsfm_colmap.ingest.metadata import read_metadata

    with tempfile.TemporaryDirectory(dir=scratch()) as folder:
        stack = Path(folder, "a.st")
        stack.write_bytes(data)
        try:
            for name in find_images(stack).names[:2]:
                found = read_header(stack / name, MAX_PIXELS)
                check_reading(read_metadata(stack / name, found))
                assert read_pixels(stack / name, found).pixels.size <= MAX_PIXELS
        except InputError as error:
            check_sentence(str(error))


def fuzz_mdoc(data: bytes) -> None:
    """Bytes as the notes beside a stack of three images, and as its angles."""
    from semsfm_colmap.errors import InputError
    from semsfm_colmap.ingest.metadata.tilt_stack import read_stack_notes

    for name in ("a.st.mdoc", "a.rawtlt"):
        with tempfile.TemporaryDirectory(dir=scratch()) as folder:
            Path(folder, name).write_bytes(data)
            try:
                notes = read_stack_notes(Path(folder, "a.st"), 3)
            except InputError as error:
                check_sentence(str(error))
                continue
            assert all(abs(tilt) <= 720 for tilt in notes.tilt_deg.values())
            assert notes.pixel_size_um is None or 0 < notes.pixel_size_um < math.inf


TARGETS: dict[str, Callable[[bytes], None]] = {
    "zeiss": fuzz_tags(34118),
    "fei": fuzz_tags(34682),
    "fei_xml": fuzz_tags(34683),
    "tescan": fuzz_tags(50431),
    "jeol": fuzz_tags(270),
    "openfibsem": fuzz_tags(270),
    "phenom": fuzz_tags(34683),
    "fibics": fuzz_tags(51023),
    "memento": fuzz_memento,
    "calibration": fuzz_calibration,
    "sidecar": fuzz_sidecar,
    "file": fuzz_file,
    "table": fuzz_table,
    "stack": fuzz_stack,
    "mdoc": fuzz_mdoc,
}

SIZES = ((1024, 943), (943, 1024), (884, 1024), (512, 442), (2048, 1536))
ZEISS = (
    b"0\r\n0\r\n0\r\n4.883000e-009\r\nDP_SEM\r\nSEM = SUPRA 40\r\nAP_WD\r\nWD =  8.5 mm\r\n"
    b"DP_DETECTOR_CHANNEL\r\nSignal A = SE2\r\nAP_MAG\r\nMag =   4.57 K X\r\n"
    b"AP_ACTUALKV\r\nEHT =  3.00 kV\r\nAP_STAGE_AT_T\r\nStage at T = 30.0 \xb0\r\n"
    b"AP_IMAGE_PIXEL_SIZE\r\nImage Pixel Size = 4.883 nm\r\nAP_WIDTH\r\nWidth = 5.000 \xb5m\r\n"
    b"AP_HEIGHT\r\nHeight = 4.316 \xb5m\r\nDP_IMAGE_STORE\r\nStore resolution = 1024 * 884\r\n"
    b"AP_SCANROTATION\r\nScan Rotation = 10.0 \xb0\r\nDP_SCAN_ROT\r\nScan Rot = Off\r\n"
    b"DP_TILT_CORRECTION\r\nTilt Corrn. = On\r\nDP_DYNAMIC_FOCUS\r\nDyn.Focus = On\r\n"
)
XML = (
    b"<Metadata><BinaryResult><PixelSize><X>2e-8</X></PixelSize></BinaryResult><StageSettings>"
    b"<StagePosition><Tilt><Alpha>0.5</Alpha></Tilt></StagePosition></StageSettings></Metadata>"
)
DOCTYPE = b'<!DOCTYPE a [<!ENTITY b "c"><!ENTITY d "&b;&b;&b;&b;">]><Metadata><A>&d;</A></Metadata>'
JEOL_TILT = (
    b"$CM_FORMAT JEOL\r\n$CM_PIXEL_SIZE 25nm\r\n$CM_FULL_SIZE 1024 884\r\n"
    b"$$SM_TILT_CORRECTION 30.0\r\n$SM_TILT_CORR on\r\n$$SM_DYNAMIC_FOCUS 1\r\n"
)
HITACHI = (
    b"[SemImageFile]\r\nInstructName=S-4800\r\nDataSize=1280x960\r\nPixelSize=24.80469\r\n"
    b"SignalName=SE(M)\r\nAcceleratingVoltage=5000 Volt\r\nMagnification=4000\r\n"
    b"WorkingDistance=8700 um\r\nMicronMarker=2000\r\nStagePositionX=40523500\r\n"
    b"StagePositionY=38240000\r\nStagePositionR=0\r\nStagePositionZ=8000000\r\n"
    b"StagePositionT=0\r\n"
)
JEOL = (
    b"$CM_INSTRUMENT JSM-7001F\r\n$CM_ACCEL_VOLT 15.00\r\n$CM_MAG 5000\r\n$CM_SIGNAL SEI\r\n"
    b"$CM_FULL_SIZE 1280 960\r\n$CM_FIELD_OF_VIEW 5.000\xb5m 3.400\xb5m\r\n$CM_PIXEL_SIZE 25nm\r\n"
    b"$CM_STAGE_POSITION X=37.1, Y=44.9, R=354.9, Z=16.90, T=12.50\r\n"
    b"$CM_STAGE_POS 37.1 44.9 16.90 354.9 12.5 0\r\n$$SM_MICRON_BAR 80\r\n"
    b"$$SM_MICRON_MARKER 2um\r\n$$SM_WD 10.2\r\n$SM_PNU_HEIGHT 64\r\n$$SM_SCAN_ROTATION 10.00\r\n"
)
TABLE = (
    b"image,tilt_deg,rotation_deg,displacement_um,pixel_size_um\na.tif,1.5,-3,,0.02\nb,2,,0.1,\n"
)


OPENFIBSEM = (
    b'{"image": {"beam_type": "ELECTRON", "resolution": [1024, 884]}, "pixel_size": {"x": 1e-7, '
    b'"y": 1e-7}, "microscope_state": {"stage_position": {"x": 0, "y": 0, "z": 0, "t": 0.1}, '
    b'"electron_beam": {"working_distance": 0.004, "voltage": 2000, "scan_rotation": 0}}}'
)
PHENOM = (
    b'<FeiImage><databarHeight>17</databarHeight><pixelWidth unit="nm">156.25</pixelWidth>'
    b'<acquisition><scan><highVoltage unit="kV">15</highVoltage></scan></acquisition></FeiImage>'
)
FIBICS = (
    b'<Fibics><Image><Width>1024</Width><Height>884</Height></Image><Scan><FOV_X units="um">25'
    b"</FOV_X><Ux>0.1</Ux><Uy>0</Uy></Scan><Stage><Tilt units='deg'>5</Tilt></Stage></Fibics>"
)
MEMENTO = (
    b"<MementoItemCollection><item><key><string>Stage</string></key><value><item><key><string>T"
    b"</string></key><value><anyType>-0.2</anyType></value></item></value></item>"
    b"</MementoItemCollection>"
)
MDOC = (
    b"PixelSpacing = 250\nImageSize = 6 4\n\n[T = Tilt axis angle = -12.5, binning = 1]\n\n"
    b"[ZValue = 0]\nTiltAngle = -3\n[ZValue = 1]\nTiltAngle = 0\n[ZValue = 2]\nTiltAngle = 3\n"
)
ANGLES = b" -3.00\n  0.00\n  3.00\n"


def header(data: bytes) -> Any:
    """An image to go with a header text: of the size most seeds speak of, turned, or resized."""
    from semsfm_colmap.ingest.files.header import ImageHeader

    width, height = SIZES[len(data) % len(SIZES)]
    return ImageHeader(format="tiff", width=width, height=height, bits=8, channels=1)


def scratch() -> str | None:
    """Memory-backed scratch space where there is some."""
    return "/dev/shm" if os.access("/dev/shm", os.W_OK) else None


def seeds(target: str, data: Path | None) -> list[bytes]:
    """Inputs to start from: real headers, and the ones above."""
    found = {
        "zeiss": [ZEISS],
        "fei_xml": [XML, DOCTYPE, b"<a>" * 40],
        "jeol": [JEOL, JEOL_TILT],
        "openfibsem": [OPENFIBSEM],
        "phenom": [PHENOM],
        "fibics": [FIBICS],
        "memento": [MEMENTO],
        "calibration": [b"\x80\x02\0\0\x64\0\0\0unit=um\n", b"12345678/><Image><Pixels"],
        "sidecar": [HITACHI, JEOL, JEOL_TILT],
        "table": [TABLE],
        "stack": [tiny_stack()],
        "mdoc": [MDOC, ANGLES],
    }.get(target, [])
    if target == "file":
        found = [tiny_tiff(), *tiny_others()]
    tags = {"zeiss": 34118, "fei": 34682, "fei_xml": 34683, "tescan": 50431}
    if data is not None:
        if target in tags:
            from semsfm_colmap.ingest.metadata.tags import read_raw_tags

            for path in sorted(data.glob("*.tif")):
                raw = read_raw_tags(path, 0).get(tags[target])
                found += [raw[:MAX_INPUT]] if raw else []
        if target == "sidecar":
            found += [path.read_bytes()[:MAX_INPUT] for path in sorted(data.glob("*.hdr"))]
        if target == "file":
            found += [without_pixels(path) for path in sorted(data.glob("*.tif"))]
    return found or [b"[User]\r\nDate=1\r\n", b"AP_WD\r\nWD = 3 mm\r\n"]


def tiny_stack() -> bytes:
    """A small MRC stack of three images in 16 bits."""
    import struct

    start = bytearray(1024)
    struct.pack_into("<4i", start, 0, 6, 4, 3, 1)
    struct.pack_into("<3i", start, 28, 6, 4, 3)
    struct.pack_into("<6f", start, 40, 1500.0, 1000.0, 750.0, 90.0, 90.0, 90.0)
    struct.pack_into("<3i", start, 64, 1, 2, 3)
    start[208:216] = b"MAP DD\0\0"
    return bytes(start) + bytes(range(144))


def tiny_tiff() -> bytes:
    """A small TIFF with a vendor tag."""
    import io

    import numpy as np
    import tifffile

    buffer = io.BytesIO()
    text = b"[Scan]\r\nPixelWidth=2e-8\r\n[Stage]\r\nStageT=0.5\r\n"
    tifffile.imwrite(
        buffer, np.arange(48, dtype=np.uint8).reshape(6, 8), compression="lzw", metadata=None,
        extratags=[(34682, 2, len(text), text, True)],
    )  # fmt: skip
    return buffer.getvalue()


def tiny_others() -> list[bytes]:
    """Small images: PNG, JPEG, BMP; colour, palette, 16 bits, floats; turned, big-endian, pages."""
    import io

    import numpy as np
    import tifffile
    from PIL import Image

    grey = np.arange(48, dtype=np.uint8).reshape(6, 8) * 5
    colour = np.repeat(grey[..., None], 3, axis=2)
    colour[:2] = (255, 200, 0)
    image = Image.fromarray(grey)
    exif = Image.Exif()
    exif[274] = 6
    found = []
    for kind, picture in (
        *((kind, image) for kind in ("png", "jpeg", "bmp")),
        *(("png", Image.fromarray(colour).convert(mode)) for mode in ("RGB", "RGBA", "P", "1")),
        ("jpeg", Image.fromarray(colour)),
        ("png", Image.fromarray(grey.astype(np.uint16) * 257)),
    ):
        buffer = io.BytesIO()
        picture.save(buffer, format=kind, **({} if kind == "bmp" else {"exif": exif}))
        found.append(buffer.getvalue())
    floats = np.where(grey > 100, np.nan, grey).astype(np.float32)
    for pixels, options in (
        (floats, {"compression": "zlib", "predictor": True}),
        (colour, {"photometric": "rgb", "planarconfig": "contig"}),
        (grey.astype(np.uint16), {"byteorder": ">", "extratags": [(274, 3, 1, 6, True)]}),
        (grey.astype(np.int16) - 50, {"bigtiff": True}),
        (grey > 100, {"photometric": "miniswhite"}),
        (np.stack([grey, grey]), {"photometric": "minisblack"}),
    ):
        buffer = io.BytesIO()
        tifffile.imwrite(buffer, pixels, metadata=None, **options)
        found.append(buffer.getvalue())
    return found


def without_pixels(path: Path) -> bytes:
    """A real file's tags in a new TIFF of a few pixels, to keep inputs short."""
    import io

    import numpy as np
    import tifffile

    from semsfm_colmap.ingest.metadata.tags import read_raw_tags

    raw = read_raw_tags(path, 0)
    extra = [(code, 1, len(text[:8000]), text[:8000], True) for code, text in raw.items()]
    buffer = io.BytesIO()
    tifffile.imwrite(buffer, np.eye(8, dtype=np.uint16), extratags=extra, metadata=None)
    return buffer.getvalue()


def mutate(data: bytes, corpus: list[bytes], rng: random.Random) -> bytes:
    """One to four random changes: bits, bytes, numbers, lines, pieces of other inputs."""
    out = bytearray(data)
    for _ in range(rng.randint(1, 4)):
        kind = rng.randrange(7)
        at = rng.randrange(len(out) + 1)
        if kind == 0 and out:
            out[at - 1] ^= 1 << rng.randrange(8)
        elif kind == 1 and out:
            out[at - 1] = rng.choice(b"\x00\xff\n\r=[]0-.eE9<&$")
        elif kind == 2:
            del out[at : at + rng.randint(1, 64)]
        elif kind == 3:
            piece = bytes(out[at : at + rng.randint(1, 64)])
            out[at:at] = piece * rng.randint(1, 20)
        elif kind == 4:
            out[at:at] = rng.choice(
                [b"1e999", b"-1e308", b"nan", b"9" * 400, b"\x00" * 8, b"\xff" * 8, b"0", b"-0"]
            )
        elif kind == 5:
            other = rng.choice(corpus)
            start = rng.randrange(len(other) + 1)
            out[at : at + 32] = other[start : start + rng.randint(1, 200)]
        elif kind == 6 and len(out) >= 4:
            start = rng.randrange(len(out) - 3)
            out[start : start + 4] = rng.choice(
                [b"\xff\xff\xff\xff", b"\x00\x00\x00\x80", b"\x00\x00\x00\x00", b"\xff\xff\xff\x7f"]
            )
    return bytes(out[:MAX_INPUT])


def fuzz_by_mutation(target: str, seconds: float, corpus: list[bytes], findings: Path) -> int:
    """Plain mutation without coverage; returns 1 on a finding."""
    rng = random.Random(os.environ.get("FUZZ_SEED", "0"))
    run = TARGETS[target]
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_MB << 21, MEMORY_MB << 21))
    end = time.monotonic() + seconds
    count = 0
    while time.monotonic() < end:
        data = mutate(rng.choice(corpus), corpus, rng)
        start = time.monotonic()
        try:
            run(data)
            if time.monotonic() - start > SECONDS_PER_INPUT:
                raise TimeoutError(f"{time.monotonic() - start:.1f} s")
        except Exception as error:
            findings.mkdir(parents=True, exist_ok=True)
            path = findings / f"{target}-{count}.bin"
            path.write_bytes(data)
            print(f"{target}: {type(error).__name__}: {error}; input in {path}")
            return 1
        count += 1
    print(f"{target}: {count} inputs in {seconds:.0f} s, nothing found")
    return 0


def fuzz_with_atheris(target: str, seconds: float, data: Path | None, findings: Path) -> None:
    """Coverage-guided; does not return (libFuzzer ends the process)."""
    import atheris

    # What is imported before cannot be instrumented.
    with atheris.instrument_imports(include=["semsfm_colmap.ingest", "tifffile"]):
        import tifffile  # noqa: F401

        import semsfm_colmap.ingest.files.raster
        import semsfm_colmap.ingest.metadata.registry
        import semsfm_colmap.ingest.series.table  # noqa: F401
    corpus = seeds(target, data)
    findings.mkdir(parents=True, exist_ok=True)
    folder = tempfile.mkdtemp(prefix=f"corpus-{target}-", dir=scratch())
    for index, seed in enumerate(corpus):
        Path(folder, f"seed{index}").write_bytes(seed)
    arguments = [
        sys.argv[0], f"-max_total_time={int(seconds)}", f"-max_len={MAX_INPUT}",
        f"-rss_limit_mb={MEMORY_MB}", f"-timeout={SECONDS_PER_INPUT}", "-print_final_stats=1",
        f"-artifact_prefix={findings}/{target}-", folder,
    ]  # fmt: skip
    atheris.Setup(arguments, TARGETS[target])
    atheris.Fuzz()


def has_atheris() -> bool:
    """Whether the coverage-guided fuzzer is installed."""
    from importlib.util import find_spec

    return find_spec("atheris") is not None


def main(arguments: Iterable[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--target", choices=[*TARGETS, "all"], default="all")
    parser.add_argument("--seconds", type=float, default=60.0, help="per target")
    parser.add_argument("--data", type=Path, help="folder with real files to start from")
    parser.add_argument("--findings", type=Path, default=Path("fuzz_findings"))
    parser.add_argument("--plain", action="store_true", help="mutate without coverage")
    chosen = parser.parse_args(list(arguments) if arguments is not None else None)
    if chosen.target == "all":
        passed_on = ["--seconds", str(chosen.seconds), "--findings", str(chosen.findings)]
        passed_on += ["--data", str(chosen.data)] if chosen.data else []
        passed_on += ["--plain"] if chosen.plain else []
        codes = [
            subprocess.run(
                [sys.executable, __file__, "--target", target, *passed_on], check=False
            ).returncode
            for target in TARGETS
        ]
        return int(any(codes))
    if chosen.plain or not has_atheris():
        corpus = seeds(chosen.target, chosen.data)
        return fuzz_by_mutation(chosen.target, chosen.seconds, corpus, chosen.findings)
    fuzz_with_atheris(chosen.target, chosen.seconds, chosen.data, chosen.findings)
    return 0


if __name__ == "__main__":
    sys.exit(main())
