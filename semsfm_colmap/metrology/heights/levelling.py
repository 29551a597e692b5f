"""The F-operation of ISO 25178-2: nominal form taken out of a height map.

A form is fitted to the measured cells by least squares of the heights under Huber's loss, whose
scale is that of the residual heights: pits and dust do not move it. Holes stay holes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.geometry.losses import HUBER_TUNING, MAD_TO_SIGMA, weight
from semsfm_colmap.metrology.heights.height_map import NUM_REWEIGHTINGS, HeightMap
from semsfm_colmap.types import Float

Form = Literal["none", "plane", "polynomial", "sphere"]
SETTLED = 1e-9
"""Relative change of the residual's scale at which the weights have settled."""
MAX_SPHERE_STEPS = 50


@dataclass(frozen=True, kw_only=True, eq=False)
class Levelled:
    """A height map without its form."""

    height_map: HeightMap
    form: Float
    """(rows, columns) what was taken out, in holes too; nan beyond the rim of a sphere"""
    radius: float | None = None
    """of a sphere, positive where the surface bulges upward"""


def level(height_map: HeightMap, form: Form = "plane", *, degree: int = 2) -> Levelled:
    """Take a form out of a height map; what is left has the mean 0.

    plane: ``a + b x + c y``; polynomial: all ``x^i y^j`` with i + j <= degree; sphere:
    ``z0 +- sqrt(R^2 - (x - x0)^2 - (y - y0)^2)``; none: the mean alone.

    Parameters
    ----------
    degree : of the polynomial, 1 or more

    Raises
    ------
    InputError
        The heights do not decide the form.

    """
    z, measured = height_map.z, height_map.measured
    x, y = scaled_places(height_map)
    radius = None
    if form == "none":
        surface = np.full(z.shape, np.mean(z[measured]))
    elif form == "sphere":
        surface, radius = _sphere(height_map)
    else:
        if degree < 1:
            raise UsageError(f"{degree=} but a polynomial form has a degree of 1 or more")
        powers = exponents(1 if form == "plane" else degree)
        columns = np.stack([x**i * y**j for i, j in powers], axis=-1)
        surface = columns @ _robust(columns[measured], z[measured])
    left = z - surface
    left = left - np.mean(left[np.isfinite(left)])
    return Levelled(height_map=height_map.with_heights(left), form=surface, radius=radius)


def exponents(degree: int) -> list[tuple[int, int]]:
    """All (i, j) with i + j <= degree, the constant first."""
    return [(total - j, j) for total in range(degree + 1) for j in range(total + 1)]


def scaled_places(height_map: HeightMap) -> tuple[Float, Float]:
    """Places x, y of the cells, -1 to 1 over the longer side: their powers stay comparable."""
    rows, columns = height_map.z.shape
    dx, dy = height_map.spacing
    x, y = np.meshgrid(np.arange(columns) * dx, np.arange(rows) * dy)
    half = max(float(x.max()), float(y.max())) / 2.0
    return (x - x.max() / 2.0) / half, (y - y.max() / 2.0) / half


def _robust(columns: Float, z: Float) -> Float:
    """Coefficients that minimise Huber's loss of ``z - columns @ coefficients``."""
    root = np.ones(len(z))
    before = np.inf
    for _ in range(NUM_REWEIGHTINGS):
        found, _, rank, _ = np.linalg.lstsq(root[:, None] * columns, root * z, rcond=1e-10)
        if rank < columns.shape[1]:
            raise InputError("The measured cells do not decide the form: take a simpler one.")
        residual = z - columns @ found
        scale = MAD_TO_SIGMA * float(np.median(np.abs(residual)))
        if not scale > 0.0 or abs(scale - before) <= SETTLED * scale:
            break
        before = scale
        root = np.sqrt(weight("huber", (residual / scale) ** 2, HUBER_TUNING))
    return np.asarray(found)


def _sphere(height_map: HeightMap) -> tuple[Float, float]:
    """Heights of the fitted sphere and its signed radius.

    Gauss-Newton on the heights, with s = +1 or -1 the side:
    ``dz = dz0 + s (x - x0) / r dx0 + s (y - y0) / r dy0 + s R / r dR``, r the root in `level`.
    The start is the paraboloid ``a + b x + c y - q (x^2 + y^2)`` with 1 / (2 q) = s R.
    """
    z, measured = height_map.z, height_map.measured
    rows, columns = z.shape
    X, Y = np.meshgrid(
        np.arange(columns) * height_map.spacing[0], np.arange(rows) * height_map.spacing[1]
    )
    cx, cy = X.mean(), Y.mean()
    x, y, h = X[measured] - cx, Y[measured] - cy, z[measured]
    a, b, c, q = _robust(np.stack([np.ones_like(x), x, y, -(x**2 + y**2)], axis=1), h)
    if not abs(q) > 1e-12 / max(np.ptp(x), np.ptp(y)):
        raise InputError("The surface is not curved: take plane as the form.")
    side, R = np.sign(q), 0.5 / abs(q)
    x0, y0 = b / (2.0 * q), c / (2.0 * q)
    R = max(R, 1.01 * float(np.sqrt((x - x0) ** 2 + (y - y0) ** 2).max()))
    z0 = a + q * (x0**2 + y0**2) - side * R
    p = np.array([z0, x0, y0, R])
    for _ in range(MAX_SPHERE_STEPS):
        square = p[3] ** 2 - (x - p[1]) ** 2 - (y - p[2]) ** 2
        inside = square > (0.05 * p[3]) ** 2
        if inside.sum() < 10:
            raise InputError("No sphere fits the surface: take plane or polynomial as the form.")
        r = np.sqrt(square[inside])
        J = np.stack(
            [np.ones_like(r), side * (x[inside] - p[1]) / r, side * (y[inside] - p[2]) / r,
             side * p[3] / r], axis=1,
        )  # fmt: skip
        step = _robust(J, h[inside] - p[0] - side * r)
        p = p + step
        if np.abs(step).max() <= 1e-10 * abs(p[3]):
            break
    square = p[3] ** 2 - (X - cx - p[1]) ** 2 - (Y - cy - p[2]) ** 2
    surface = np.where(square > 0, p[0] + side * np.sqrt(np.maximum(square, 0.0)), np.nan)
    return surface, float(side * p[3])
