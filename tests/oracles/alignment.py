"""Alignment of a patch by a general least-squares solver: slow and plain."""

import numpy as np
from scipy.ndimage import map_coordinates
from scipy.optimize import least_squares

from semsfm_colmap.types import Array, Float


def align_by_least_squares(
    reference: Array, image: Array, xy1: Float, xy2: Float, radius: int, sigma: float
) -> Float:
    """Where the patch around `xy1` is in `image`, starting from `xy2`; no warp, (2,) px."""
    inner = np.arange(-radius + 1, radius)
    px, py = np.meshgrid(inner, inner)
    root = np.exp(-0.25 * (px**2 + py**2) / sigma**2)

    def read(pixels: Array, x: float, y: float) -> Float:
        return np.asarray(
            map_coordinates(pixels.astype(float), [py + y - 0.5, px + x - 0.5], order=3)
        )

    T = read(reference, *xy1)

    def residuals(p: Float) -> Float:
        u, v, a, b, cx, cy = p
        model = a * T + b + cx * px + cy * py
        return np.asarray((root * (read(image, xy2[0] + u, xy2[1] + v) - model)).ravel())

    result = least_squares(residuals, [0.0, 0.0, 1.0, 0.0, 0.0, 0.0], x_scale="jac")
    return np.asarray(xy2 + result.x[:2])


def catmull_rom(image: Array, x: float, y: float) -> float:
    """The cubic through four points with central differences as slopes, along rows, then down."""
    M = 0.5 * np.array([[0, 2, 0, 0], [-1, 0, 1, 0], [2, -5, 4, -1], [-1, 3, -3, 1]])
    i, j = int(np.floor(x)), int(np.floor(y))
    values = image[j - 1 : j + 3, i - 1 : i + 3].astype(float)
    fx, fy = np.array([x - i, y - j])[:, None] ** np.arange(4)
    return float(fy @ M @ values @ M.T @ fx)
