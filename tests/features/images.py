"""Images with known content for the tests of features."""

from __future__ import annotations

from functools import lru_cache

import numpy as np


def textured(shape=(240, 320), seed=0):
    """Band-limited noise with structure at several scales, 8-bit range, as float64."""
    return _textured(tuple(shape), seed).copy()


@lru_cache
def _textured(shape, seed):
    import cv2

    rng = np.random.default_rng(seed)
    h, w = shape
    image = np.zeros((h, w))
    for sigma, weight in ((1.5, 1.0), (3.0, 1.0), (6.0, 1.0), (12.0, 1.0)):
        layer = cv2.GaussianBlur(rng.normal(size=(h, w)), (0, 0), sigma)
        image += weight * layer / layer.std()
    return 128.0 + 25.0 * image


def disk(shape, centre, radius, blur=1.0, level=90.0, contrast=100.0):
    """A disk, exact in area per pixel, then blurred; centre in COLMAP's coordinates."""
    import cv2

    over = 8
    g = (np.arange(over) + 0.5) / over
    y = (np.arange(shape[0])[:, None] + g[None]).reshape(-1)
    x = (np.arange(shape[1])[:, None] + g[None]).reshape(-1)
    inside = (x[None] - centre[0]) ** 2 + (y[:, None] - centre[1]) ** 2 <= radius**2
    cells = inside.reshape(shape[0], over, shape[1], over).mean(axis=(1, 3))
    return level + contrast * cv2.GaussianBlur(cells, (0, 0), blur)


def warp_image(image, matrix, shift, shape):
    """The image under ``x2 = matrix @ x1 + shift`` in COLMAP's coordinates, by splines."""
    from scipy.ndimage import map_coordinates

    y, x = np.mgrid[: shape[0], : shape[1]] + 0.5
    inverse = np.linalg.inv(matrix)
    source = np.stack([x - shift[0], y - shift[1]], -1) @ inverse.T - 0.5
    return map_coordinates(image, [source[..., 1], source[..., 0]], order=3, mode="reflect")
