"""One source file: what it holds, and which part of it is image."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from semsfm_colmap.ingest.files.header import ImageHeader, UnreadableImageError
from semsfm_colmap.ingest.files.raster import RawImage, suffix_matches
from semsfm_colmap.ingest.files.read import read_header, read_pixels
from semsfm_colmap.ingest.frame.databar import (
    coloured_databar,
    find_databar,
    looks_drawn,
    to_levels,
)
from semsfm_colmap.ingest.frame.enhance import changes_pixels
from semsfm_colmap.ingest.frame.scale_bar import (
    ScaleBar,
    find_bar_over_image,
    find_scale_bar,
)
from semsfm_colmap.ingest.metadata import MetadataReading, read_metadata
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.types import Array

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
    """Length of the scale bar drawn in the databar or over the image, where it was looked for."""
    crop: Crop = (0, 0, 0, 0)
    changes: bool = False
    """Whether an option changes the pixels, so that the file cannot be copied."""
    warnings: tuple[str, ...] = ()

    def warn(self, sentence: str) -> SourceImage:
        """The same image with one more warning."""
        return replace(self, warnings=(*self.warnings, sentence))


def scan_image(path: Path, name: str, options: IngestOptions) -> tuple[SourceImage, RawImage]:
    """Header, metadata and databar of one file, with its pixels."""
    header = read_header(path, options.max_image_pixels)
    raw = read_pixels(path, header)
    low, high = raw.pixels.min(), raw.pixels.max()
    if low == high:
        raise UnreadableImageError(f"every pixel has the value {low:g}, there is nothing to see.")
    row = None
    if options.crop is None and options.detect_databar:
        row = _seen_databar(raw)
    header = replace(header, image_rows=row)
    reading = read_metadata(path, header)
    warnings = list(reading.warnings)
    if not suffix_matches(path, header):
        warnings.append(f"the content is {header.format.upper()}, not what the suffix says")
    if header.orientation != 1:
        warnings.append(
            f"the file asks to be shown turned (orientation {header.orientation}): done so, "
            "its tilt axis is turned too"
        )
    if header.num_pages > 1:
        warnings.append(
            f"the file holds {header.num_pages} pages of one size, of which one is used; a TIFF "
            "whose pages are a series is given in the place of the folder"
        )
    if raw.invalid is not None:
        warnings.append(
            f"{int(raw.invalid.sum())} pixels are nan or infinite: set to the darkest value"
        )
    height, width = raw.pixels.shape
    if options.crop is None and options.detect_databar:
        row, warning = _databar_row(raw, row, reading)
        warnings.extend([warning] if warning else [])
        if row is None:
            warnings.extend(_databar_elsewhere(raw))
    bar = None
    if (options.scale_bar_um or reading.scale_bar_um) is not None:
        bar, warning = _scale_bar(raw, row, reading, options)
        warnings.extend([warning] if warning else [])
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


def check_content(cropped: Array) -> None:
    """Refuse the kept part of an image where it shows nothing."""
    if cropped.min() == cropped.max():
        raise UnreadableImageError("every pixel of the cropped image has the same value.")


def _scale_bar(
    raw: RawImage, row: int | None, reading: MetadataReading, options: IngestOptions
) -> tuple[ScaleBar | None, str | None]:
    """The scale bar in the databar, else over the image; and what to say where there is none.

    Below a crop of the user's is where the databar is.
    """
    levels = to_levels(raw.pixels)
    if row is None and options.crop is not None and options.crop[3] < len(levels):
        row = options.crop[3]
    bar = None if row is None else find_scale_bar(levels[row:])
    if bar is None:
        coloured = None if raw.coloured is None else raw.coloured[:row]
        lossy = raw.header.lossy
        bar = find_bar_over_image(levels[:row], coloured, lossy=lossy)
    if bar is not None:
        return bar, None
    if options.scale_bar_um is None and reading.metadata.pixel_size_um is not None:
        return None, None  # only the header speaks of one, and the scale is known
    where = "over the image" if row is None else "in the databar or over the image"
    return None, (
        f"no scale bar was found {where}, or several of different lengths; give pixel_size_um"
    )


def _databar_elsewhere(raw: RawImage) -> list[str]:
    """A sentence about a databar at the top or at a side, with the crop that leaves it out."""
    height, width = raw.pixels.shape
    for turned, side in ((raw.pixels[::-1], "top"), (raw.pixels.T, "right"),
                         (raw.pixels.T[::-1], "left")):  # fmt: skip
        row = find_databar(np.ascontiguousarray(turned), lossy=raw.header.lossy)
        if row is not None:
            crop = {
                "top": (0, height - row, width, height),
                "right": (0, 0, row, height),
                "left": (width - row, 0, width, height),
            }[side]
            numbers = " ".join(map(str, crop))
            return [f"a databar seems to be at the {side}: give --crop {numbers} to cut it off"]
    return []


def _seen_databar(raw: RawImage) -> int | None:
    """The databar's first row from the pixels."""
    seen = find_databar(raw.pixels, lossy=raw.header.lossy)
    if seen is None and raw.coloured is not None:
        seen = coloured_databar(raw.coloured)
    return seen


def _databar_row(
    raw: RawImage, seen: int | None, reading: MetadataReading
) -> tuple[int | None, str | None]:
    """The databar's first row as it was seen, checked against what the vendor says."""
    lossy = raw.header.lossy
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
