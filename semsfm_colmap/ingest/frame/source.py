"""First pass over the images: what each file holds and which part of it is image."""

from __future__ import annotations

import hashlib
from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from semsfm_colmap.errors import UsageError
from semsfm_colmap.ingest.files.drawn_colour import coloured_databar
from semsfm_colmap.ingest.files.header import ImageHeader, UnreadableImageError
from semsfm_colmap.ingest.files.raster import RawImage, read_header, read_pixels, suffix_matches
from semsfm_colmap.ingest.frame.databar import (
    MAX_FRACTION,
    MIN_ROWS,
    agree_on_databar,
    find_databar,
    looks_drawn,
    to_levels,
)
from semsfm_colmap.ingest.frame.enhance import changes_pixels
from semsfm_colmap.ingest.frame.overlay import ConstantPixels, Overlay, find_overlay
from semsfm_colmap.ingest.frame.scale_bar import find_scale_bar
from semsfm_colmap.ingest.metadata import MetadataReading, read_metadata
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.io.wording import abbreviate
from semsfm_colmap.types import Array

MIN_SIDE_PX = 32
"""Images smaller than this after cropping hold no features."""
MAX_SIZES = 4
"""Burnt-in writing is looked for in the images of so many sizes; each takes two in memory."""

Progress = Callable[[int, int], None]
Crop = tuple[int, int, int, int]


@dataclass(frozen=True, kw_only=True)
class SourceImage:
    """One readable source file and the part of it to keep."""

    name: str
    path: Path
    header: ImageHeader
    size: tuple[int, int]
    """(width, height) as shown, after the file's orientation."""
    reading: MetadataReading
    databar_row: int | None = None
    scale_bar_px: float | None = None
    """Length of the scale bar drawn in the databar, where it was looked for."""
    crop: Crop = (0, 0, 0, 0)
    changes: bool = False
    """Whether an option changes the pixels, so that the file cannot be copied."""
    warnings: tuple[str, ...] = ()

    def warn(self, sentence: str) -> SourceImage:
        """The same image with one more warning."""
        return replace(self, warnings=(*self.warnings, sentence))


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
    seen: dict[bytes, str] = {}
    for count, name in enumerate(names):
        path = root / name
        try:
            image, raw = scan_image(path, name, options)
            check_copy(raw, name, seen)
            images.append(image)
            if image.size in constant or len(constant) < MAX_SIZES:
                constant[image.size].add(
                    _without_databar(image, raw), lossy=image.header.format == "jpeg"
                )
        except UnreadableImageError as error:
            problems.append(f"{name}: {error} Left out.")
        if progress:
            progress(count + 1, len(names))
    found = {size: find_overlay(frames) for size, frames in constant.items()}
    return Scan(
        images=tuple(images),
        problems=tuple(problems),
        overlays={size: overlay for size, overlay in found.items() if overlay is not None},
    )


def scan_image(path: Path, name: str, options: IngestOptions) -> tuple[SourceImage, RawImage]:
    """Header, metadata and databar of one file, with its pixels."""
    header = read_header(path, options.max_image_pixels)
    raw = read_pixels(path, header)
    low, high = raw.pixels.min(), raw.pixels.max()
    if low == high:
        raise UnreadableImageError(f"every pixel has the value {low:g}, there is nothing to see.")
    reading = read_metadata(path, header)
    warnings = list(reading.warnings)
    if not suffix_matches(path, header):
        warnings.append(f"the content is {header.format.upper()}, not what the suffix says")
    if header.orientation != 1:
        warnings.append(
            f"the file asks to be shown turned (orientation {header.orientation}): done so, "
            "its tilt axis is turned too"
        )
    if raw.invalid is not None:
        warnings.append(
            f"{int(raw.invalid.sum())} pixels are nan or infinite: set to the darkest value"
        )
    height, width = raw.pixels.shape
    row = None
    if options.crop is None and options.detect_databar:
        row, warning = _databar_row(raw, reading)
        warnings.extend([warning] if warning else [])
    bar = None
    if row is not None and (options.scale_bar_um or reading.scale_bar_um) is not None:
        bar = find_scale_bar(to_levels(raw.pixels)[row:])
        if bar is None:
            warnings.append("no scale bar was found in the databar")
    image = SourceImage(
        name=name,
        path=path,
        header=header,
        size=(width, height),
        reading=reading,
        databar_row=row,
        scale_bar_px=bar.length_px if bar else None,
        crop=(0, 0, width, height if row is None else row),
        changes=changes_pixels(options),
        warnings=tuple(warnings),
    )
    return image, raw


def _without_databar(image: SourceImage, raw: RawImage) -> Array:
    """8-bit levels with the databar, whose writing is known, blanked."""
    levels = to_levels(raw.pixels)
    if image.databar_row is not None:
        levels = levels.copy()
        levels[image.databar_row :] = 0
    return levels


def check_copy(raw: RawImage, name: str, seen: dict[bytes, str]) -> None:
    """Refuse an image with the pixels of one in `seen`, to which it is added."""
    first = seen.setdefault(_digest(raw), name)
    if first != name:
        raise UnreadableImageError(f"the pixels are those of {first}.")


def _digest(raw: RawImage) -> bytes:
    pixels = np.ascontiguousarray(raw.pixels)
    shape = repr((pixels.shape, pixels.dtype.str)).encode()
    return hashlib.blake2b(pixels.data, digest_size=16, key=shape[:64]).digest()


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


def check_content(cropped: Array) -> None:
    """Refuse the kept part of an image where it shows nothing."""
    if cropped.min() == cropped.max():
        raise UnreadableImageError("every pixel of the cropped image has the same value.")


def _databar_row(raw: RawImage, reading: MetadataReading) -> tuple[int | None, str | None]:
    """The databar's first row from the pixels, checked against what the vendor says."""
    lossy = raw.header.format == "jpeg"
    seen = find_databar(raw.pixels, lossy=lossy)
    if seen is None and raw.coloured is not None:
        seen = coloured_databar(raw.coloured, MIN_ROWS, MAX_FRACTION)
    said = reading.image_rows
    if said is None and reading.databar_rows is not None:
        # The bar may have been cut off since: believe the number only if the rows look drawn.
        row = raw.pixels.shape[0] - reading.databar_rows
        said = row if looks_drawn(raw.pixels, row, lossy=lossy) else None
    if said is None or seen == said:
        return seen, None
    if seen is None:
        return said, None
    return seen, f"a databar was found at row {seen} but the header says {said}; the former is used"


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
