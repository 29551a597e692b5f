"""Small drawn images: texture, a databar as microscopes draw it, writing, colour; and files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from semsfm_colmap.ingest.files.raster import read_header, read_pixels

Array = NDArray[np.generic]


def texture(seed: int, height: int = 160, width: int = 200) -> NDArray[np.uint8]:
    """Smooth blobs with the grain of a scan."""
    rng = np.random.default_rng(seed)
    coarse = rng.normal(size=(height // 8 + 2, width // 8 + 2))
    rows = np.linspace(0, coarse.shape[0] - 1.001, height)
    columns = np.linspace(0, coarse.shape[1] - 1.001, width)
    r, c = rows.astype(int), columns.astype(int)
    fr, fc = (rows - r)[:, None], (columns - c)[None, :]
    smooth = (
        coarse[r][:, c] * (1 - fr) * (1 - fc)
        + coarse[r + 1][:, c] * fr * (1 - fc)
        + coarse[r][:, c + 1] * (1 - fr) * fc
        + coarse[r + 1][:, c + 1] * fr * fc
    )
    noisy = 120 + 35 * smooth + rng.normal(scale=6, size=smooth.shape)
    return np.clip(np.rint(noisy), 1, 254).astype(np.uint8)


def with_databar(image: Array, rows: int = 24, *, background: int = 0, line: bool = True) -> Array:
    """Draw a databar over the bottom rows: background, text-like strokes, a scale bar."""
    out = image.copy()
    height, width = out.shape
    top = height - rows
    ink = 255 - background
    out[top:] = background
    if line:
        out[top : top + 2] = 190
    for x in range(6, width // 2, 5):
        out[top + 6 : top + 13, x] = ink
        out[top + 9, x : x + 3] = ink
    out[top + 15, width // 2 + 10 : width - 10] = ink
    for x in (width // 2 + 10, width - 11):
        out[top + 12 : top + 19, x] = ink
    return out


def save(path: Path, image: Array, **options: object) -> Path:
    """Write an image in the format of its suffix."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix.lower() in (".tif", ".tiff"):
        import tifffile

        tifffile.imwrite(path, image, **options)
    else:
        from PIL import Image

        Image.fromarray(image).save(path, **options)
    return path


def stamped(image: np.ndarray) -> np.ndarray:
    """An image with a scale bar and a label burnt in."""
    out = image.copy()
    out[20:24, 15:75] = 255  # a scale bar
    out[30:40, 20:70:6] = 255  # a label
    return out


def in_colour(image: np.ndarray, colour: tuple[int, int, int] = (255, 230, 0)) -> np.ndarray:
    """Grey stored as RGB with an annotation in one colour: an arrow, a frame, a label."""
    out = np.repeat(image[..., None], 3, axis=2)
    out[30:33, 40:120] = colour
    out[20:60, 150:152] = out[20:60, 180:182] = colour
    out[20:22, 150:182] = out[58:60, 150:182] = colour
    out[40:50, 60:100:4] = colour
    return out


ANNOTATION = in_colour(np.zeros((160, 200), np.uint8)).max(axis=2) > 0


def written(path: Path) -> np.ndarray:
    """Pixels of a file that was written, by other readers than ours."""
    if path.suffix.lower() in (".tif", ".tiff"):
        import tifffile

        return tifffile.imread(path)
    from PIL import Image

    return np.asarray(Image.open(path))


def pixels_of(path: Path) -> np.ndarray:
    """Pixels of a source file, as ingest reads it."""
    return read_pixels(path, read_header(path, 10**9)).pixels
