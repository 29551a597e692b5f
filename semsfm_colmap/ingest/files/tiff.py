"""TIFF files: the page that holds the image, its header and its samples."""

from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from semsfm_colmap.errors import InputError
from semsfm_colmap.ingest.files.header import ImageHeader, UnreadableImageError
from semsfm_colmap.io.wording import one_line
from semsfm_colmap.types import Array

MAX_CHANNELS = 16
MAX_BITS = 64
MAX_COMPRESSION = 20_000
"""Deflate reaches 1032, LZW and run lengths less, JPEG and its like some thousands."""
LOSSY_COMPRESSION = (6, 7, 33003, 33005, 34712, 34892, 50001, 50002)
"""JPEG, JPEG 2000 and their like; WebP, JPEG XL."""
MAX_PAGES = 32
"""Pages of a TIFF looked at to find the first full-size one."""


def open_tiff(path: Path) -> Any:
    """A tifffile.TiffFile that keeps its complaints about broken tags to itself."""
    import tifffile

    logging.getLogger("tifffile").setLevel(logging.CRITICAL)
    return tifffile.TiffFile(path)


def is_tiff_stack(path: Path) -> bool:
    """Whether a path is a TIFF file, each page of which may be an image."""
    return path.suffix.lower() in (".tif", ".tiff") and path.is_file()


def page_names(path: Path) -> tuple[str, ...]:
    """``tilts_0001.tif``, ... for the pages of a TIFF that have the size of the first full one."""
    try:
        count = len(_full_pages(path))
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    except Exception as error:  # a hostile header may raise anything
        raise InputError(f"{path}: the header is damaged ({one_line(str(error))}).") from error
    return tuple(f"{path.stem}_{k + 1:04d}{path.suffix}" for k in range(count))


def page_header(path: Path) -> ImageHeader:
    """The header of one page, addressed as a file in a folder of the TIFF's name."""
    number = int(path.stem.rpartition("_")[2]) - 1
    page = _full_pages(path.parent)[number]
    return replace(tiff_header(path.parent), page=page, num_pages=1)


def _full_pages(path: Path) -> list[int]:
    first = tiff_header(path)
    with open_tiff(path) as tiff:
        return [
            index
            for index, page in enumerate(tiff.pages)
            if not page.is_reduced
            and (int(page.imagewidth), int(page.imagelength)) == (first.width, first.height)
        ]


def tiff_header(path: Path) -> ImageHeader:
    """Size and depth of the first full-size page."""
    with open_tiff(path) as tiff:
        pages = []
        for index in range(MAX_PAGES):
            try:
                pages.append(tiff.pages[index])
            except IndexError:
                break
            except Exception:  # a damaged later page does not spoil the first one
                if not pages:
                    raise
                break
        if not pages:
            raise UnreadableImageError("the TIFF holds no image.")
        best = _full_size_page(pages)
        page = pages[best]
        return ImageHeader(
            format="tiff",
            width=int(page.imagewidth),
            height=int(page.imagelength),
            bits=int(page.bitspersample),
            channels=int(page.samplesperpixel),
            page=best,
            orientation=_tiff_orientation(page),
            lossy=int(page.compression) in LOSSY_COMPRESSION,
            num_pages=_num_pages(tiff, pages, best),
        )


def _num_pages(tiff: Any, looked_at: list[Any], best: int) -> int:
    """Pages of the size of the best one; of a long stack all are taken to be alike."""
    size = (looked_at[best].imagewidth, looked_at[best].imagelength)
    alike = [not p.is_reduced and (p.imagewidth, p.imagelength) == size for p in looked_at]
    if len(looked_at) < MAX_PAGES or not all(alike):
        return sum(alike)
    try:
        return len(tiff.pages)
    except Exception:  # a damaged later page
        return sum(alike)


def _tiff_orientation(page: Any) -> int:
    tag = page.tags.get(274)
    value = int(tag.value) if tag is not None and isinstance(tag.value, int) else 1
    return value if 1 <= value <= 8 else 1


def _full_size_page(pages: list[Any]) -> int:
    """The first page that is neither marked as reduced nor smaller than another one."""
    area = [
        0 if page.is_reduced else int(page.imagewidth) * int(page.imagelength) for page in pages
    ]
    return int(np.argmax(area))


def decode_tiff(path: Path, header: ImageHeader) -> tuple[Array, bool]:
    """Samples (H, W) or (H, W, C) of the page that `header` describes, 0 = black.

    Also whether the last channel says how opaque a pixel is.
    """
    with open_tiff(path) as tiff:
        page = tiff.pages[header.page]
        if int(page.imagedepth) != 1:
            raise UnreadableImageError("the TIFF holds a volume, not an image.")
        _check_amount(page, header)
        array = np.asarray(page.asarray(maxworkers=1))
        if array.ndim == 3 and int(page.planarconfig) == 2:
            array = np.moveaxis(array, 0, -1)
        photometric = int(page.photometric)
        if photometric == 3 and page.colormap is not None:
            return _apply_palette(array, np.asarray(page.colormap)), False
        if array.dtype == np.bool_:
            array = array.astype(np.uint8) * 255
        if photometric == 5 and array.ndim == 3 and array.shape[-1] >= 4:
            return _rgb_of_inks(array), False
        if photometric == 8 and array.ndim == 3:
            return array[..., 0], False  # CIELAB
        has_alpha = array.ndim == 3 and _says_alpha(page)
        if photometric == 0:
            samples = array[..., :1] if has_alpha else array
            if array.dtype.kind in "ui":
                samples = ~samples
            elif array.dtype.kind == "f":
                samples = -samples
            array = np.concatenate([samples, array[..., 1:]], axis=-1) if has_alpha else samples
        return array, has_alpha


def _says_alpha(page: Any) -> bool:
    """Whether the one sample beyond grey or RGB is associated or unassociated alpha."""
    extra = tuple(int(kind) for kind in page.extrasamples)
    return len(extra) == 1 and extra[0] in (1, 2)


def _rgb_of_inks(array: Array) -> Array:
    """Cyan, magenta, yellow and black (H, W, 4 or more), 0 = no ink, as RGB."""
    if array.dtype.kind not in "u":
        raise UnreadableImageError(f"inks of type {array.dtype} are not understood; save as grey.")
    full = float(np.iinfo(array.dtype).max)
    light = 1.0 - array[..., :4].astype(np.float64) / full
    return np.asarray(np.rint(full * light[..., :3] * light[..., 3:]).astype(array.dtype))


def _check_amount(page: Any, header: ImageHeader) -> None:
    """Refuse a page that promises more pixels than its data can hold, before memory is taken."""
    if header.channels > MAX_CHANNELS or header.bits > MAX_BITS:
        raise UnreadableImageError(
            f"{header.channels} channels of {header.bits} bits are not an image."
        )
    stored = int(sum(page.databytecounts))
    if stored == 0:
        raise UnreadableImageError("the TIFF holds no pixels.")
    needed = header.width * header.height * header.channels * header.bits / 8
    uncompressed = int(page.compression) == 1
    if stored * (1 if uncompressed else MAX_COMPRESSION) < needed:
        raise UnreadableImageError(
            f"{stored} bytes cannot hold {header.width} x {header.height} pixels; the file is "
            "damaged or truncated."
        )


def _apply_palette(index: Array, colormap: Array) -> Array:
    """Colours (3, 2^bits) of 16 bits looked up and reduced to 8."""
    if colormap.ndim != 2 or index.max(initial=0) >= colormap.shape[1]:
        raise UnreadableImageError("the TIFF's palette is shorter than its pixel values.")
    return np.asarray((colormap.astype(np.uint16) >> 8).astype(np.uint8).T[index])
