"""Let the table and the scale bar complete, or override, what the files record."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import degrees, radians

import numpy as np

from semsfm_colmap.ingest.frame.source import SourceImage
from semsfm_colmap.ingest.series.table import SeriesTable, match_table
from semsfm_colmap.types import SemMetadata

SAME_TILT_DEG = 0.5
SAME_SIZE = 0.005
SCALE_BAR_AGREEMENT = 0.03
"""A measured scale bar is off by a pixel at either end: 1-2 % of a short one."""


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
                reading=replace(
                    image.reading, metadata=_with(old, values, f"table {table.path.name}")
                ),
            )
        )
    worst = max((abs(v - np.median(tilt_differs)) for v in tilt_differs), default=0.0)
    if worst > SAME_TILT_DEG:
        warnings.append(
            f"the tilts in {table.path.name} differ from those in the files by up to {worst:.2g} "
            "degrees; the table is used."
        )
    worst = max((abs(v) for v in size_differs), default=0.0)
    if worst > SAME_SIZE:
        warnings.append(
            f"the pixel sizes in {table.path.name} differ from those in the files by up to "
            f"{worst:.1%}; the table is used."
        )
    return changed, warnings


def apply_scale_bar(image: SourceImage, label_um: float | None) -> SourceImage:
    """Take the pixel size from the scale bar, or check the recorded one against it."""
    label = label_um if label_um is not None else image.reading.scale_bar_um
    if label is None or image.scale_bar_px is None:
        return image
    measured = label / image.scale_bar_px
    metadata = image.reading.metadata
    if metadata.pixel_size_um is None:
        source = f"scale bar: {label:g} um over {image.scale_bar_px:.4g} px"
        new = _with(metadata, {"pixel_size_um": measured}, source)
        return replace(image, reading=replace(image.reading, metadata=new))
    if abs(measured / metadata.pixel_size_um - 1) > SCALE_BAR_AGREEMENT:
        return image.warn(
            f"the scale bar of {label:g} um is {image.scale_bar_px:.4g} px long, which makes "
            f"{measured:.4g} um per pixel, but {metadata.pixel_size_um:.4g} um are recorded; the "
            "latter is used, give pixel_size_um if it is wrong"
        )
    return image


def _with(metadata: SemMetadata, values: dict[str, float], source: str) -> SemMetadata:
    sources = {**metadata.source, **dict.fromkeys(values, source)}
    return replace(metadata, **values, source=sources)  # type: ignore[arg-type]
