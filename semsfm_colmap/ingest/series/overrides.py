"""Let the table and the scale bar complete, or override, what the files record."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import replace
from math import degrees, radians

import numpy as np

from semsfm_colmap.ingest.frame.source import SourceImage
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.ingest.series.table import (
    SeriesTable,
    match_table,
    read_series_table,
    table_of_names,
)
from semsfm_colmap.io.wording import abbreviate
from semsfm_colmap.types import SemMetadata

SAME_TILT_DEG = 0.5
SAME_SIZE = 0.005
SCALE_BAR_AGREEMENT = 0.03
"""A measured scale bar is off by a pixel at either end: 1-2 % of a short one."""
SAME_BAR = 0.02
DISPLAY_MM = (40.0, 800.0)
"""Width of the display or photograph that a magnification refers to: from small photographs
to large screens; 127 mm is usual."""
FIELD_UM = (0.01, 50_000.0)
"""Field of view of a SEM: from 10 nm at two million times to a stage seen as a whole."""


def apply_table(
    images: Sequence[SourceImage], table: SeriesTable
) -> tuple[list[SourceImage], list[str]]:
    """Replace what the files record by what the table says, and say where they differ."""
    rows, warnings = match_table(table, [image.name for image in images])
    changed: list[SourceImage] = []
    tilt_differs: list[float] = []
    size_differs: list[float] = []
    for image in images:
        row = rows.get(image.name)
        if row is None:
            changed.append(image)
            continue
        old = image.reading.metadata
        values: dict[str, float] = {}
        if row.tilt_deg is not None:
            values["tilt_rad"] = radians(row.tilt_deg)
            if old.tilt_rad is not None:
                tilt_differs.append(row.tilt_deg - degrees(old.tilt_rad))
        if row.rotation_deg is not None:
            values["stage_rotation_rad"] = radians(row.rotation_deg)
        if row.displacement_um is not None:
            values["displacement_um"] = row.displacement_um
        if row.pixel_size_um is not None:
            values["pixel_size_um"] = row.pixel_size_um
            if old.pixel_size_um is not None:
                size_differs.append(row.pixel_size_um / old.pixel_size_um - 1)
        changed.append(
            replace(
                image,
                reading=replace(image.reading, metadata=_with(old, values, table.source)),
            )
        )
    worst = max((abs(v - np.median(tilt_differs)) for v in tilt_differs), default=0.0)
    if worst > SAME_TILT_DEG:
        warnings.append(
            f"the tilts in {table.title} differ from those in the files by up to {worst:.2g} "
            "degrees; the former are used."
        )
    worst = max((abs(v) for v in size_differs), default=0.0)
    if worst > SAME_SIZE:
        warnings.append(
            f"the pixel sizes in {table.title} differ from those in the files by up to "
            f"{worst:.1%}; the table is used."
        )
    return changed, warnings


def apply_tables(
    images: Sequence[SourceImage], options: IngestOptions
) -> tuple[list[SourceImage], list[str]]:
    """What the names say where they are asked, then the table, which has the last word."""
    changed = list(images)
    warnings: list[str] = []
    if options.tilt_from_names and images:
        changed, warnings = apply_table(changed, table_of_names([i.name for i in images]))
    if options.series_csv and images:
        changed, more = apply_table(changed, read_series_table(options.series_csv))
        warnings = [*warnings, *more]
    return changed, warnings


def apply_scale_bars(
    images: Sequence[SourceImage], options: IngestOptions
) -> tuple[list[SourceImage], list[str]]:
    """Take pixel sizes from the scale bars, or check the recorded ones against them.

    A bar has one length in all images of a size with one label; what differs from most is no bar.
    """
    lengths: dict[tuple[tuple[int, int], float], list[float]] = defaultdict(list)
    count: Counter[tuple[tuple[int, int], float]] = Counter()
    for image in images:
        label = _label(image, options)
        if label is not None:
            count[image.size, label] += 1
            if image.scale_bar_px is not None:
                lengths[image.size, label].append(image.scale_bar_px)
    changed: list[SourceImage] = []
    doubted: list[str] = []
    for image in images:
        label = _label(image, options)
        if label is None or image.scale_bar_px is None:
            changed.append(image)
            continue
        found = lengths[image.size, label]
        agreeing = sum(abs(v / image.scale_bar_px - 1) <= SAME_BAR for v in found)
        if 2 * agreeing <= len(found) or 2 * agreeing < count[image.size, label]:
            doubted.append(image.name)
            changed.append(replace(image, scale_bar_px=None))
        else:
            changed.append(_with_scale_bar(image, label, options))
    if not doubted:
        return changed, []
    return changed, [
        f"{abbreviate(doubted)}: what looks like a scale bar has another length than in the other "
        "images, or is missing in most of them; it is not used."
    ]


def _label(image: SourceImage, options: IngestOptions) -> float | None:
    """What is written at the bar of an image."""
    given = options.scale_bar_um
    return given if given is not None else image.reading.scale_bar_um


def _with_scale_bar(image: SourceImage, label: float, options: IngestOptions) -> SourceImage:
    assert image.scale_bar_px is not None
    measured = label / image.scale_bar_px
    metadata = image.reading.metadata
    said = (
        f"the scale bar of {label:g} um is {image.scale_bar_px:.4g} px long, which makes "
        f"{measured:.4g} um per pixel"
    )
    recorded = options.pixel_size_um or metadata.pixel_size_um
    if recorded is not None:
        if abs(measured / recorded - 1) <= SCALE_BAR_AGREEMENT:
            return image
        by = "given" if options.pixel_size_um else "recorded"
        return image.warn(
            f"{said}, but {recorded:.4g} um are {by}; the latter is used"
            + ("" if options.pixel_size_um else ", give pixel_size_um if it is wrong")
        )
    doubt = _implausible(measured, image)
    if doubt:
        return image.warn(f"{said}, and {doubt}; it is not used, give pixel_size_um")
    source = f"scale bar: {label:g} um over {image.scale_bar_px:.4g} px"
    new = _with(metadata, {"pixel_size_um": measured}, source)
    return replace(image, reading=replace(image.reading, metadata=new))


def _implausible(um: float, image: SourceImage) -> str | None:
    """Why a pixel size cannot be that of an image of a SEM; None if it can."""
    field_um = um * image.size[0]
    magnification = image.reading.metadata.magnification
    if magnification is not None:
        display_mm = field_um * magnification * 1e-3
        if not DISPLAY_MM[0] <= display_mm <= DISPLAY_MM[1]:
            return (
                f"with the magnification of {magnification:g} recorded, {field_um:.3g} um in the "
                f"image would be {display_mm:.3g} mm on the display"
            )
    if not FIELD_UM[0] <= field_um <= FIELD_UM[1]:
        return f"the image would be {field_um:.3g} um wide"
    return None


def _with(metadata: SemMetadata, values: dict[str, float], source: str) -> SemMetadata:
    sources = {**metadata.source, **dict.fromkeys(values, source)}
    return replace(metadata, **values, source=sources)  # type: ignore[arg-type]
