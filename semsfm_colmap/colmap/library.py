"""pycolmap, imported in the one order that works.

cv2 and PIL must come first: the zlib inside the pycolmap wheel otherwise shadows theirs, and
writing a PNG aborts the process. Everything in this package takes pycolmap from here.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import cv2
import PIL.Image

from semsfm_colmap.io.interrupt import signals_held

with signals_held():  # its logging takes SIGTERM for itself
    import pycolmap

__all__ = ["pycolmap", "without_log_lines"]

assert cv2 is not None
assert PIL.Image is not None
# COLMAP's own log lines would break up the progress display; warnings still come through
pycolmap.logging.minloglevel = int(pycolmap.logging.Level.WARNING)


@contextmanager
def without_log_lines() -> Iterator[None]:
    """Keep COLMAP from writing to the terminal what it raises as an error besides."""
    before = pycolmap.logging.minloglevel
    pycolmap.logging.minloglevel = int(pycolmap.logging.Level.FATAL)
    try:
        yield
    finally:
        pycolmap.logging.minloglevel = before
