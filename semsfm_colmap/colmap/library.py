"""pycolmap, imported in the one order that works.

cv2 and PIL must come first: the zlib inside the pycolmap wheel otherwise shadows theirs, and
writing a PNG aborts the process. Everything in this package takes pycolmap from here.
"""

from __future__ import annotations

import cv2
import PIL.Image
import pycolmap

__all__ = ["pycolmap"]

assert cv2 is not None
assert PIL.Image is not None
# COLMAP's own log lines would break up the progress display; warnings still come through
pycolmap.logging.minloglevel = int(pycolmap.logging.Level.WARNING)
