"""Grey images: prepared ones and masks of a project read back, and those of others."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from semsfm_colmap.errors import InputError
from semsfm_colmap.io.apart import ONE_FILE, DiedError, call_apart
from semsfm_colmap.types import Array, Bool


def read_grey(path: Path) -> Array:
    """Pixels (H, W) of an 8-bit image file; through numpy, as cv2 cannot open every path."""
    import cv2

    try:
        data = np.fromfile(path, dtype=np.uint8)
        pixels = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE) if len(data) else None
    except (OSError, cv2.error):
        pixels = None
    if pixels is None:
        raise InputError(f"{path} cannot be read: run `semsfm extract` again")
    return np.asarray(pixels)


def read_grey_of_others(path: Path) -> Array:
    """The same of a file that another program wrote, in a process that may die of it."""
    try:
        return call_apart(ONE_FILE, read_grey, path.absolute())
    except DiedError as died:
        raise InputError(
            f"{path} ended the process that decoded it ({died}): write the image again with the "
            "program that made it"
        ) from died


def read_mask(mask_path: Path | None, name: str) -> Bool | None:
    """COLMAP's convention: <image name>.png, zero where nothing is to be found."""
    path = None if mask_path is None else mask_path / f"{name}.png"
    return read_grey(path) > 0 if path is not None and path.is_file() else None
