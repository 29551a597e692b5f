"""First pass over the images: what each file holds, copies, and writing burnt into all of them."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from semsfm_colmap.ingest.files.header import UnreadableImageError
from semsfm_colmap.ingest.files.raster import RawImage
from semsfm_colmap.ingest.frame.databar import to_levels
from semsfm_colmap.ingest.frame.overlay import ConstantPixels, Overlay, find_overlay
from semsfm_colmap.ingest.frame.source import SourceImage, scan_image
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.ingest.series.copies import View, leave_out_copies, view_of
from semsfm_colmap.types import Array

MAX_SIZES = 4
"""Burnt-in writing is looked for in the images of so many sizes; each takes two in memory."""

Progress = Callable[[int, int], None]


@dataclass(frozen=True, kw_only=True, eq=False)
class Scan:
    """What the first pass found: usable images, sentences about the others, burnt-in writing."""

    images: tuple[SourceImage, ...]
    problems: tuple[str, ...]
    overlays: Mapping[tuple[int, int], Overlay]
    """By image size."""


def scan_images(
    root: Path, names: Sequence[str], options: IngestOptions, progress: Progress | None = None
) -> Scan:
    """Read every file once; files that cannot be used become sentences."""
    images: list[SourceImage] = []
    problems: list[str] = []
    constant: dict[tuple[int, int], ConstantPixels] = defaultdict(ConstantPixels)
    views: list[View] = []
    for count, name in enumerate(names):
        path = root / name
        try:
            image, raw = scan_image(path, name, options)
            views.append(view_of(image, raw))
            images.append(image)
            if image.size in constant or len(constant) < MAX_SIZES:
                constant[image.size].add(_without_databar(image, raw), lossy=image.header.lossy)
        except UnreadableImageError as error:
            problems.append(f"{name}: {error} Left out.")
        if progress:
            progress(count + 1, len(names))
    found = {size: find_overlay(frames) for size, frames in constant.items()}
    keep, copies, repeated = leave_out_copies(images, views)
    return Scan(
        images=tuple(images[k] for k in keep),
        problems=(*problems, *copies, *repeated),
        overlays={size: overlay for size, overlay in found.items() if overlay is not None},
    )


def _without_databar(image: SourceImage, raw: RawImage) -> Array:
    """8-bit levels with the databar, whose writing is known, blanked."""
    levels = to_levels(raw.pixels)
    if image.databar_row is not None:
        levels = levels.copy()
        levels[image.databar_row :] = 0
    return levels
