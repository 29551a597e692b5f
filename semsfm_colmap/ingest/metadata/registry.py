"""Which vendor wrote a file: try each reader on what it recognises."""

from __future__ import annotations

from pathlib import Path

from semsfm_colmap.ingest.files.header import ImageHeader
from semsfm_colmap.ingest.files.tiff import is_tiff_stack
from semsfm_colmap.ingest.metadata import (
    calibration,
    fei,
    fibics,
    jeol,
    openfibsem,
    phenom,
    tescan,
    tilt_stack,
    zeiss,
)
from semsfm_colmap.ingest.metadata.reading import Collector, MetadataReading
from semsfm_colmap.ingest.metadata.sidecar import read_sidecar
from semsfm_colmap.ingest.metadata.tags import (
    DESCRIPTION,
    FEI_HELIOS,
    FEI_SFEG,
    FEI_XML,
    FIBICS,
    TESCAN,
    ZEISS,
    read_raw_tags,
)
from semsfm_colmap.ingest.metadata.text import decode
from semsfm_colmap.io.wording import one_line

EXPECTED = {
    "pixel_size_um": "pixel size",
    "tilt_rad": "stage tilt",
    "working_distance_um": "working distance",
    "beam_energy_kev": "beam energy",
    "instrument": "instrument",
    "detector": "detector",
}
STRAY_TEXT_BYTES = 1 << 16
"""Where a TIFF's directory is damaged, FEI's text is still looked for in this much of its end."""


def read_metadata(path: Path, header: ImageHeader) -> MetadataReading:
    """What is recorded in or beside a file; an empty reading where nothing is.

    Headers are foreign data: whatever goes wrong in one becomes a warning of its file.
    """
    if header.format == "mrc":
        return tilt_stack.read_section(path)
    if is_tiff_stack(path.parent):
        path = path.parent
    problem = None
    reading = None
    tags: dict[int, bytes] = {}
    try:
        tags = read_raw_tags(path, header.page) if header.format == "tiff" else {}
        reading = read_tags(tags, header)
    except Exception as error:  # a hostile directory may raise anything
        problem = f"the TIFF tags cannot be read ({one_line(str(error))})"
    if reading is None:
        reading = read_sidecar(path, header)
    if reading is None and header.format == "tiff":
        reading = _read_stray_text(path, header) or calibration.read(tags, header)
        if reading is not None and reading.vendor != "FEI":
            return reading  # programs other than microscopes record nothing else
    if reading is None and header.format == "jpeg":
        reading = _read_after_jpeg(path, header)
    if reading is None:
        return MetadataReading(warnings=(problem,) if problem else ())
    return _with_missing(reading, problem)


def read_tags(tags: dict[int, bytes], header: ImageHeader) -> MetadataReading | None:
    """Metadata from the raw tags of a TIFF; None where no vendor is recognised."""
    if ZEISS in tags:
        return zeiss.read(tags, header)
    if phenom.ROOT in (xml := decode(tags.get(FEI_XML, b""))):
        return phenom.read(xml, f"Phenom {FEI_XML}", header)
    if any(code in tags for code in (FEI_HELIOS, FEI_SFEG, FEI_XML)):
        return fei.read(tags, header)
    if TESCAN in tags:
        sections = tescan.parse_tag(tags[TESCAN])
        if sections:
            return tescan.read(sections, f"TESCAN {TESCAN}", header)
    if FIBICS in tags:
        return fibics.read(decode(tags[FIBICS]), header)
    if DESCRIPTION in tags:
        description = decode(tags[DESCRIPTION])
        values = jeol.parse(description)
        if values:
            return jeol.read(values, "ImageDescription", header)
        content = openfibsem.parse(description)
        if content:
            return openfibsem.read(content, header)
    return None


def _read_stray_text(path: Path, header: ImageHeader) -> MetadataReading | None:
    """FEI's text at the end of a file whose directory does not lead to it any more."""
    with path.open("rb") as file:
        size = file.seek(0, 2)
        file.seek(max(0, size - STRAY_TEXT_BYTES))
        end = file.read(STRAY_TEXT_BYTES)
    start = end.find(b"[User]")
    if start < 0 or not any(mark in end for mark in (b"[EBeam]", b"[Beam]", b"[Scan]")):
        return None
    out = Collector("FEI")
    fei.read_text(decode(end[start:]), "FEI text outside its tag", header, out)
    out.warn("the TIFF directory is damaged: the header was found as text at the end of the file")
    return out.reading()


def _read_after_jpeg(path: Path, header: ImageHeader) -> MetadataReading | None:
    """Phenom's XML behind the end of a JPEG."""
    with path.open("rb") as file:
        size = file.seek(0, 2)
        file.seek(max(0, size - STRAY_TEXT_BYTES))
        end = file.read(STRAY_TEXT_BYTES)
    start = end.rfind(phenom.ROOT.encode())
    if start < 0:
        return None
    return phenom.read(decode(end[start:]), "Phenom XML behind the JPEG", header)


def _with_missing(reading: MetadataReading, problem: str | None) -> MetadataReading:
    """Add what the vendor's header should hold and does not."""
    missing = [words for name, words in EXPECTED.items() if getattr(reading.metadata, name) is None]
    warnings = list(reading.warnings)
    if problem:
        warnings.append(problem)
    if reading.metadata.tilt_corrected:
        warnings.append(
            "tilt correction was on: the image is stretched along y by the microscope, which no "
            "rotation explains; record the series with it off"
        )
    if missing:
        warnings.append(f"the {reading.vendor} header records no {', '.join(missing)}")
    return reading.with_warnings(tuple(warnings))
