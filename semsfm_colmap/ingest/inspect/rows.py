"""A row per file: what its header says, in the units that people use."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import degrees
from pathlib import Path

from semsfm_colmap.errors import InputError
from semsfm_colmap.ingest.files.header import ImageHeader
from semsfm_colmap.ingest.files.read import read_header
from semsfm_colmap.ingest.frame.source import SourceImage
from semsfm_colmap.ingest.metadata import MetadataReading, read_metadata
from semsfm_colmap.ingest.options import IngestOptions


@dataclass(frozen=True, kw_only=True)
class InspectionRow:
    """What is known about one file; None where it is not recorded."""

    name: str
    width: int | None = None
    height: int | None = None
    bits: int | None = None
    pixel_size_um: float | None = None
    pixel_size_source: str | None = None
    tilt_deg: float | None = None
    stage_rotation_deg: float | None = None
    scan_rotation_deg: float | None = None
    working_distance_um: float | None = None
    beam_energy_kev: float | None = None
    magnification: float | None = None
    instrument: str | None = None
    detector: str | None = None
    tilt_corrected: bool | None = None
    displacement_um: float | None = None
    """Only in the text, as the next ones: the fields of the JSON and CSV files are fixed."""
    kept: tuple[int, int] | None = None
    """Width and height of what is kept, where a databar or a margin is cut off."""
    num_pages: int = 1
    warnings: tuple[str, ...] = ()


def row_of(image: SourceImage, options: IngestOptions, notes: list[str]) -> InspectionRow:
    """The row of an image, with what comparing it with the others showed."""
    row = _metadata_row(image.name, image.header, image.reading, options)
    return replace(
        row,
        width=image.size[0],
        height=image.size[1],
        kept=_kept(image),
        num_pages=image.header.num_pages,
        warnings=(*image.warnings, *notes),
    )


def _kept(image: SourceImage) -> tuple[int, int] | None:
    x0, y0, x1, y1 = image.crop
    return (x1 - x0, y1 - y0) if (x1 - x0, y1 - y0) != image.size else None


def unusable_row(path: Path, name: str, reason: str, options: IngestOptions) -> InspectionRow:
    """The row of a file whose pixels cannot be used: its header may still be read."""
    try:
        header = read_header(path, options.max_image_pixels)
        reading = read_metadata(path, header)
    except InputError:
        return InspectionRow(name=name, warnings=(reason,))
    row = _metadata_row(name, header, reading, options)
    return replace(row, warnings=(reason, *reading.warnings))


def _metadata_row(
    name: str, header: ImageHeader, reading: MetadataReading, options: IngestOptions
) -> InspectionRow:
    known = reading.metadata
    size, source = known.pixel_size_um, known.source.get("pixel_size_um")
    if options.pixel_size_um is not None:
        size, source = options.pixel_size_um, "option pixel_size_um"

    def in_degrees(value: float | None) -> float | None:
        return None if value is None else degrees(value)

    return InspectionRow(
        name=name,
        width=header.width,
        height=header.height,
        bits=header.bits,
        pixel_size_um=size,
        pixel_size_source=source,
        tilt_deg=in_degrees(known.tilt_rad),
        stage_rotation_deg=in_degrees(known.stage_rotation_rad),
        scan_rotation_deg=in_degrees(known.scan_rotation_rad),
        working_distance_um=known.working_distance_um,
        beam_energy_kev=known.beam_energy_kev,
        magnification=known.magnification,
        instrument=known.instrument,
        detector=known.detector,
        tilt_corrected=known.tilt_corrected,
        displacement_um=known.displacement_um,
    )
