"""COLMAP's depth and normal maps on disk, and our depth maps as a pinhole's.

File: ``width&height&channels&`` in ASCII, then float32 little-endian, channel by channel, row by
row. Depth 0 means unknown; normals are in the camera frame, toward the viewer.

A pinhole that stands in for an orthographic camera sees a surface point at another pixel: with
magnification s, principal point c and depth z behind the origin's plane, the pixel q of parallel
projection lands on ``p = c + (q - c) / (1 + s z / f)``. And COLMAP's dense stage takes pixel
(row, col) for the image point (col, row) of a calibration matrix whose first pixel has its centre
at (0.5, 0.5): half a pixel apart. `pinhole_depth` makes up for both: the depth at pixel (row, col)
is that of the parallel ray which the consumer's ray for this pixel meets at the surface,

    z(q) = z(centre) + slope . (q - centre),   q = c + (p - c) (1 + s z / f),   p = (col, row),

exact on planes; the rest is second order in a shift of about one pixel.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.io.atomic import write_bytes
from semsfm_colmap.types import Array, Float


def write_map(path: Path, values: Array) -> None:
    """Write a map (H, W) or (H, W, C)."""
    stack = np.asarray(values, dtype="<f4")
    if stack.ndim == 2:
        stack = stack[:, :, None]
    if stack.ndim != 3 or 0 in stack.shape:
        raise UsageError(f"{np.shape(values)=} but expected (H, W) or (H, W, C)")
    height, width, channels = stack.shape
    head = f"{width}&{height}&{channels}&".encode("ascii")
    write_bytes(head + np.ascontiguousarray(stack.transpose(2, 0, 1)).tobytes(), path)


def read_map(path: Path) -> Array:
    """Read a map: (H, W) float32 for one channel, (H, W, C) for more.

    Raises
    ------
    InputError
        The file is missing, has another head, or is cut short.

    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}).") from error
    parts = data[:64].split(b"&", 3)
    if len(parts) < 4 or not all(part.isdigit() for part in parts[:3]):
        raise InputError(f"{path} is no depth or normal map of COLMAP: its head is missing.")
    width, height, channels = (int(part) for part in parts[:3])
    start = sum(len(part) + 1 for part in parts[:3])
    count = width * height * channels
    if count == 0 or len(data) - start != 4 * count:
        raise InputError(
            f"{path} is cut short: its head says {width} x {height} x {channels}, but "
            f"{len(data) - start} bytes follow; make it again."
        )
    stack = np.frombuffer(data, dtype="<f4", offset=start).reshape(channels, height, width)
    return np.array(stack[0] if channels == 1 else stack.transpose(1, 2, 0))


def pinhole_depth(
    depth: Array,
    slope: Array,
    *,
    scaling: Float,
    scale_px_per_unit: float,
    focal_px: float,
    distance: float,
    principal_point_px: Float,
) -> Array:
    """Depth maps of the pinhole that COLMAP's dense stage believes in: (H, W) float32.

    Parameters
    ----------
    depth : (H, W) ``z`` of the orthographic camera, world units, nan where unknown
    slope : (2, H, W) its change along x and y per px of the map
    scaling : (2,) px of the map per px of the image, along x and y
    scale_px_per_unit : magnification of the image
    focal_px : the pinhole's focal length along x, px of the image
    distance : its ``T_z``, world units
    principal_point_px : (2,) px of the image

    Returns
    -------
    depth along the pinhole's axis in world units, 0 where unknown

    """
    height, width = depth.shape
    col, row = np.meshgrid(np.arange(width, dtype=float), np.arange(height, dtype=float))
    z = np.asarray(depth, dtype=np.float64)
    stretch = 1.0 + scale_px_per_unit * z / focal_px
    cx, cy = principal_point_px * scaling
    dx = cx + (col - cx) * stretch - (col + 0.5)
    dy = cy + (row - cy) * stretch - (row + 0.5)
    moved = distance + z + slope[0] * dx + slope[1] * dy
    return np.where(np.isfinite(moved), moved, 0.0).astype(np.float32)
