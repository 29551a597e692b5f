"""Which part of each image is kept: what the option says, or the frames of one size agree on."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace

from semsfm_colmap.errors import UsageError
from semsfm_colmap.ingest.frame.databar import agree_on_databar
from semsfm_colmap.ingest.frame.overlay import Overlay
from semsfm_colmap.ingest.frame.source import Crop, SourceImage
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.io.wording import abbreviate

MIN_SIDE_PX = 32
"""Images smaller than this after cropping hold no features."""


def choose_crops(
    images: Sequence[SourceImage],
    options: IngestOptions,
    overlays: Mapping[tuple[int, int], Overlay] | None = None,
) -> tuple[list[SourceImage], list[str]]:
    """Settle the crop of every image: the option, or what the frames of one size agree on."""
    overlays = overlays or {}
    chosen: list[SourceImage] = []
    problems: list[str] = []
    groups: dict[tuple[int, int], list[int | None]] = defaultdict(list)
    for image in images:
        groups[image.size].append(image.databar_row)
    agreed = {size: agree_on_databar(rows) for size, rows in groups.items()}
    for image in images:
        width, height = image.size
        if options.crop is not None:
            crop = check_crop(options.crop)
            if crop[2] > width or crop[3] > height:
                problems.append(
                    f"{image.name}: the crop {crop} reaches beyond its {width} x {height} pixels. "
                    "Left out."
                )
                continue
        else:
            row = agreed[image.size]
            overlay = overlays.get(image.size)
            if row is None and overlay is not None and options.detect_databar:
                row = overlay.databar_row
            if image.databar_row not in (row, None):
                image = image.warn(
                    f"a databar seems to start at row {image.databar_row}, unlike in the other "
                    "images of this size; give crop if so"
                )
            crop = (0, 0, width, height if row is None else row)
        if min(crop[2] - crop[0], crop[3] - crop[1]) < MIN_SIDE_PX:
            problems.append(
                f"{image.name}: {crop[2] - crop[0]} x {crop[3] - crop[1]} pixels are too few, "
                f"{MIN_SIDE_PX} a side are needed. Left out."
            )
            continue
        chosen.append(replace(image, crop=crop))
    return chosen, [*problems, *_size_warnings(chosen)]


def check_crop(crop: tuple[int, int, int, int]) -> Crop:
    """Refuse a crop that is empty or reversed."""
    x0, y0, x1, y1 = crop
    if not (0 <= x0 < x1 and 0 <= y0 < y1):
        raise UsageError(f"{crop=} but expected x0 y0 x1 y1 with 0 <= x0 < x1 and 0 <= y0 < y1.")
    return crop


def _size_warnings(images: Sequence[SourceImage]) -> list[str]:
    """One sentence for every size that is not the most frequent one."""
    sizes = Counter((i.crop[2] - i.crop[0], i.crop[3] - i.crop[1]) for i in images)
    if len(sizes) < 2:
        return []
    (width, height), _ = sizes.most_common(1)[0]
    warnings = []
    for size in sizes:
        if size != (width, height):
            names = [
                i.name for i in images if (i.crop[2] - i.crop[0], i.crop[3] - i.crop[1]) == size
            ]
            warnings.append(
                f"{abbreviate(names)}: {size[0]} x {size[1]} pixels but most images have "
                f"{width} x {height}; kept, check that they belong to the series."
            )
    return warnings
