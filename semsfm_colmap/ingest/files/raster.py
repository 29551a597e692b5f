"""Pixels of one file as a grey array, after its header has been checked.

The content decides the format, not the suffix. Nothing is decoded before the header's width and
height are known to be below the limit, so that a hostile or broken header takes no memory.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from semsfm_colmap.errors import InputError
from semsfm_colmap.ingest.files.drawn_colour import drawn_colour
from semsfm_colmap.ingest.files.header import ImageHeader, UnreadableImageError
from semsfm_colmap.ingest.files.mrc import decode_section, is_section, section_header
from semsfm_colmap.ingest.files.tiff import decode_tiff, is_tiff_stack, page_header, tiff_header
from semsfm_colmap.io.wording import one_line
from semsfm_colmap.types import Array, Float

LUMA = (0.299, 0.587, 0.114)
"""Rec. 601 weights; they sum to 1, so that grey stored as RGB comes out unchanged."""
MAX_DEFLATE = 1100
"""Deflate shrinks data by 1032 at most."""
SUFFIXES = {
    "png": (".png",),
    "jpeg": (".jpg", ".jpeg"),
    "tiff": (".tif", ".tiff"),
    "bmp": (".bmp",),
    "mrc": (".mrc",),
    "jpeg2000": (".jp2", ".j2k", ".j2c", ".jpx", ".jpf"),
    "webp": (".webp",),
    "gif": (".gif",),
}
_MAGIC = (
    (b"\x89PNG\r\n\x1a\n", "png"),
    (b"\xff\xd8\xff", "jpeg"),
    (b"II*\x00", "tiff"),
    (b"MM\x00*", "tiff"),
    (b"II+\x00", "tiff"),
    (b"MM\x00+", "tiff"),
    (b"BM", "bmp"),
    (b"\x00\x00\x00\x0cjP  \r\n\x87\n", "jpeg2000"),
    (b"\xff\x4f\xff\x51", "jpeg2000"),
    (b"GIF87a", "gif"),
    (b"GIF89a", "gif"),
)


@dataclass(frozen=True, kw_only=True, eq=False)
class RawImage:
    """Grey pixels (H, W) in the stored depth: uint8, uint16, uint32 or float32."""

    pixels: Array
    header: ImageHeader
    plain: bool
    """True when the file already holds these very pixels as 8-bit grey."""
    invalid: Array | None = None
    """(H, W) True where the file holds nan or infinity; None if nowhere."""
    coloured: Array | None = None
    """(H, W) True where colour is drawn into a grey image; None if nowhere."""
    transparent: Array | None = None
    """(H, W) True where the file says that there is no image; None if nowhere."""


def read_header(path: Path, max_pixels: int) -> ImageHeader:
    """Format, size and depth from the first bytes of a file."""
    if is_section(path):
        return _within_limit(section_header(path), max_pixels)
    if is_tiff_stack(path.parent):
        return _within_limit(page_header(path), max_pixels)
    try:
        with path.open("rb") as file:
            start = file.read(16)
    except OSError as error:
        raise UnreadableImageError(
            f"cannot be opened ({error.strerror}); check its permissions."
        ) from error
    if not start:
        raise UnreadableImageError("the file is empty; copy it again from the microscope.")
    kind = next((name for magic, name in _MAGIC if start.startswith(magic)), None)
    if start[:4] == b"RIFF" and start[8:12] == b"WEBP":
        kind = "webp"
    if kind is None:
        raise UnreadableImageError(
            "is not a PNG, JPEG, TIFF or BMP image, nor JPEG 2000, WebP, GIF, whatever its suffix."
        )
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            header = tiff_header(path) if kind == "tiff" else _pillow_header(path, kind)
    except InputError:
        raise
    except Exception as error:  # a hostile header may raise anything
        raise UnreadableImageError(f"the header is damaged ({_short(error)}).") from error
    if header.width < 1 or header.height < 1:
        raise UnreadableImageError(f"the header says {header.width} x {header.height} pixels.")
    return _within_limit(header, max_pixels)


def _within_limit(header: ImageHeader, max_pixels: int) -> ImageHeader:
    if header.width * header.height > max_pixels:
        raise UnreadableImageError(
            f"the header says {header.width} x {header.height} pixels, more than the limit of "
            f"{max_pixels}; raise max_image_pixels if that is true."
        )
    return header


def read_pixels(path: Path, header: ImageHeader) -> RawImage:
    """Decode the image that `header` describes to grey."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            if header.format == "png":
                _check_amount(path, header)
            plain, has_alpha = False, False
            if header.format == "tiff":
                file = path.parent if is_tiff_stack(path.parent) else path
                array, has_alpha = decode_tiff(file, header)
            elif header.format == "mrc":
                array = decode_section(path, header)
            elif header.format == "png" and header.bits == 16:
                array = _decode_png16(path)
                has_alpha = array.ndim == 3 and array.shape[2] in (2, 4)
            else:
                array, plain, has_alpha = _decode_pillow(path, header)
    except InputError:
        raise
    except MemoryError as error:
        raise UnreadableImageError(
            f"{header.width} x {header.height} pixels do not fit into memory."
        ) from error
    except Exception as error:  # damaged data may raise anything
        raise UnreadableImageError(
            f"the pixels cannot be decoded ({_short(error)}); the file is damaged or truncated."
        ) from error
    transparent = _transparent(array[..., -1]) if has_alpha else None
    grey = _to_grey(array[..., :-1] if has_alpha else array)
    coloured = drawn_colour(array, lossy=header.lossy)
    if grey.shape != (header.height, header.width):
        raise UnreadableImageError(
            f"{grey.shape[::-1]} pixels were decoded but the header says "
            f"{(header.width, header.height)}."
        )
    invalid = None
    if grey.dtype.kind == "f":
        finite = np.isfinite(grey)
        if not finite.all():
            if not finite.any():
                raise UnreadableImageError("every pixel is nan or infinite.")
            invalid = ~finite
            grey = np.where(finite, grey, grey[finite].min())
    if header.orientation != 1:
        grey = _oriented(grey, header.orientation)
        invalid = None if invalid is None else _oriented(invalid, header.orientation)
        coloured = None if coloured is None else _oriented(coloured, header.orientation)
        transparent = None if transparent is None else _oriented(transparent, header.orientation)
        plain = False
    return RawImage(
        pixels=grey,
        header=header,
        plain=plain,
        invalid=invalid,
        coloured=coloured,
        transparent=transparent,
    )


def _transparent(alpha: Array) -> Array | None:
    """Where less than half of a pixel is there; None if nowhere, or everywhere."""
    full = np.iinfo(alpha.dtype).max if alpha.dtype.kind in "ui" else 1.0
    missing = np.asarray(alpha < 0.5 * full)
    return missing if missing.any() and not missing.all() else None


def suffix_matches(path: Path, header: ImageHeader) -> bool:
    """Whether the suffix of a file says what its content is."""
    return path.suffix.lower() in SUFFIXES[header.format]


def _short(error: Exception) -> str:
    return one_line(str(error)) or type(error).__name__


@contextmanager
def _pillow_image(path: Path, kind: str) -> Iterator[Any]:
    """An opened Pillow image, without its own fixed limit on pixels: ours can be raised."""
    from PIL import Image

    limit = Image.MAX_IMAGE_PIXELS
    Image.MAX_IMAGE_PIXELS = None
    try:
        with Image.open(path, formats=[kind]) as image:
            yield image
    finally:
        Image.MAX_IMAGE_PIXELS = limit


def _pillow_header(path: Path, kind: str) -> ImageHeader:
    with _pillow_image(path, kind) as image:
        width, height = image.size
        bits = 8
        if kind == "png":
            with path.open("rb") as file:
                bits = file.read(25)[24]
        # Of a PNG without it before the pixels, Pillow would decode these to look behind them.
        has_exif = kind in ("jpeg", "webp") or "exif" in image.info
        orientation = int(image.getexif().get(274, 1)) if has_exif else 1
        return ImageHeader(
            format=kind,
            width=width,
            height=height,
            bits=16 if image.mode.startswith("I;16") else max(bits, 8),
            channels=len(image.getbands()),
            orientation=orientation if 1 <= orientation <= 8 else 1,
            lossy=kind in ("jpeg", "jpeg2000", "webp"),
            num_pages=int(getattr(image, "n_frames", 1)) if kind in ("gif", "webp") else 1,
        )


def _check_amount(path: Path, header: ImageHeader) -> None:
    """Refuse a PNG that promises more pixels than its bytes can hold."""
    size = path.stat().st_size
    if size * MAX_DEFLATE < header.width * header.height * header.bits / 8:
        raise UnreadableImageError(
            f"{size} bytes cannot hold {header.width} x {header.height} pixels; the file is "
            "damaged or truncated."
        )


def _decode_pillow(path: Path, header: ImageHeader) -> tuple[Array, bool, bool]:
    """Samples, whether they are these very 8-bit grey values, and whether the last is alpha."""
    with _pillow_image(path, header.format) as image:
        image.load()
        plain = image.mode == "L" or (header.format == "jpeg" and image.mode == "RGB")
        if "transparency" in image.info or image.mode in ("PA", "La", "RGBa"):
            return np.asarray(image.convert("RGBA")), False, True
        if image.mode in ("L", "RGB"):
            return np.asarray(image), plain, False
        if image.mode in ("LA", "RGBA"):
            return np.asarray(image), False, True
        if image.mode.startswith("I;16"):
            return np.asarray(image).astype(np.uint16), False, False
        return np.asarray(image.convert("RGB")), False, False


def _decode_png16(path: Path) -> Array:
    import imagecodecs

    return np.asarray(imagecodecs.png_decode(path.read_bytes()))


def _to_grey(array: Array) -> Array:
    """(H, W), (H, W, 1..4) of any depth -> (H, W) uint8, uint16, uint32 or float32."""
    if array.ndim == 3:
        channels = array.shape[2]
        if channels >= 3:
            colour = array[..., :3]
            if np.array_equal(colour[..., 0], colour[..., 1]) and np.array_equal(
                colour[..., 0], colour[..., 2]
            ):
                array = colour[..., 0]
            else:
                luma: Float = colour.astype(np.float64) @ np.array(LUMA)
                kind = array.dtype
                array = np.rint(luma).astype(kind) if kind.kind in "ui" else luma
        elif channels >= 1:
            array = array[..., 0]
    if array.ndim != 2:
        raise UnreadableImageError(f"pixels of shape {array.shape} are not an image.")
    if array.dtype in (np.uint8, np.uint16, np.uint32):
        return array
    if array.dtype.kind == "i":
        unsigned = np.dtype(f"u{array.dtype.itemsize}")
        return _to_grey((array.astype(np.int64) - array.min()).astype(unsigned))
    if array.dtype.kind in "uf":
        with np.errstate(over="ignore"):
            return array.astype(np.float32)
    raise UnreadableImageError(f"pixels of type {array.dtype} are not grey values.")


def _oriented(array: Array, orientation: int) -> Array:
    """Undo an EXIF orientation (1 to 8)."""
    if orientation in (5, 6, 7, 8):
        array = array.T
        return {
            5: array,
            6: array[:, ::-1],
            7: array[::-1, ::-1],
            8: array[::-1],
        }[orientation]
    return {2: array[:, ::-1], 3: array[::-1, ::-1], 4: array[::-1]}.get(orientation, array)
