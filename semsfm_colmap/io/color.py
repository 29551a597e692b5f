"""Colour images of other programs, read as they are."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from semsfm_colmap.io.apart import ONE_FILE, DiedError, call_apart
from semsfm_colmap.types import Array


def read_color(path: Path) -> Array | None:
    """Pixels (H, W, 3) uint8, red first, of an image file; None when it cannot be read."""
    try:
        return call_apart(ONE_FILE, decoded_color, path.absolute())
    except DiedError:
        return None


def decoded_color(path: Path) -> Array | None:
    """The same in this process."""
    import cv2

    try:
        data = np.fromfile(path, dtype=np.uint8)
        pixels = cv2.imdecode(data, cv2.IMREAD_COLOR) if len(data) else None
    except (OSError, cv2.error):
        return None
    return None if pixels is None else np.ascontiguousarray(np.asarray(pixels)[:, :, ::-1])
