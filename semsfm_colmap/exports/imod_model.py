"""IMOD's binary model files, as its manual describes them (binspec, version 1.2): open contours.

Big-endian throughout: the id ``IMODV1.2``, a header of 232 bytes, an ``OBJT`` of 176 bytes, a
``CONT`` of 16 bytes and 12 for each point a contour, ``IEOF``. Model coordinates run from 0 to the
size of the images in x and y, the middle of the first pixel being 0.5, and sections from 0 in z.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np

from semsfm_colmap.types import Float

Z_FROM_MINUS_HALF = 1 << 10
NOT_YET_BY_3DMOD = 1 << 11
MULTIPLE_CLIP_PLANES = 1 << 12
MATERIAL_AS_BYTES = 1 << 13
OPEN_CONTOURS = 1 << 3
"""Flags of the model, and of the object."""
GREEN = (0.0, 1.0, 0.0)
CIRCLE = 0
"""Symbol at the points, SYMBOL_PX in size."""
SYMBOL_PX = 5


def open_contour_model(contours: Sequence[Float], size_px: tuple[int, int, int]) -> bytes:
    """A model of one object that holds each contour (K, 3) as an open one.

    Parameters
    ----------
    size_px : width, height and number of sections of the images

    """
    flags = Z_FROM_MINUS_HALF | NOT_YET_BY_3DMOD | MULTIPLE_CLIP_PLANES | MATERIAL_AS_BYTES
    model = struct.pack(
        ">8s128s4iI4i6f5ifii3f",
        b"IMODV1.2",
        b"fiducials",
        *(*size_px, 1),
        flags,
        *(1, 1, 0, 255),  # drawn, model mode, black and white level
        *(0.0, 0.0, 0.0, 1.0, 1.0, 1.0),  # offsets, scales
        *(0, 0, 0, 3, 128),  # current object, contour, point; resolution, threshold
        1.0,  # a pixel is the unit
        *(0, 0),
        *(0.0, 0.0, 0.0),
    )
    header = struct.pack(
        ">4s64s16IiI2i3fi8B2i",
        b"OBJT",
        b"fiducials",
        *(0,) * 16,
        len(contours),
        OPEN_CONTOURS,
        *(0, 1),  # axis, draw mode
        *GREEN,
        0,
        *(CIRCLE, SYMBOL_PX, 1, 1, 0, 0, 0, 0),
        *(0, 0),  # meshes, surfaces
    )
    parts = [model, header]
    for points in contours:
        parts.append(struct.pack(">4siIii", b"CONT", len(points), 0, 0, 0))
        parts.append(np.ascontiguousarray(points, dtype=">f4").tobytes())
    return b"".join([*parts, b"IEOF"])
