"""Linear and robust Gaussian filters of ISO 16610 on profiles and height maps with holes.

The weighting function of the Gaussian filter with nesting index (cut-off) L is along each axis

    s(x) = exp(-pi (x / (alpha L))^2) / (alpha L),    alpha = sqrt(ln 2 / pi),

[ISO 16610-21, -61]: a wave of length L passes with half of its amplitude, one of
length l with ``exp(-pi (alpha L / l)^2)``. It is cut at |x| = L, where it has fallen to 7e-7.

Beside holes and at the ends, where weights are missing, a polynomial of degree `order` is fitted
under the weights at every place and its value there taken:

    min over b of  sum_k s(x_k - x) delta_k (z_k - b0 - b1 (x_k - x) - ...)^2,  w(x) = b0.

Order 0 is normalised convolution, 1 keeps planes, 2 keeps curvature up to the ends (regression
filters of ISO 16610-28, -31 and -71). Inside of a full grid orders 0 and 1 are the same filter, and
order 2 passes shorter waves than the nesting index says.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
from scipy.ndimage import correlate1d

from semsfm_colmap.errors import UsageError
from semsfm_colmap.types import Array, Bool, Float

ALPHA = float(np.sqrt(np.log(2.0) / np.pi))
TUKEY = 4.4478
"""Rejection beyond so many median absolute residuals: three standard deviations [16610-31]."""
MAX_ROBUST_ROUNDS = 50
ROBUST_SETTLED = 1e-3
"""Relative change of the median residual at which the robust filter has settled."""
MIN_SUPPORT = 1e-6
"""Share of the weights that must lie on measured cells for a place to have a value."""
RIDGE = 1e-9
"""Relative: where few cells are near, the local polynomial is not decided and is kept flat."""


def gaussian(z: Float, spacing: Sequence[float], nesting_index: float, *, order: int = 1) -> Float:
    """Gaussian filter of a profile (N,) or a height map (rows, columns): its smooth part.

    Parameters
    ----------
    z : heights, nan in holes, which stay holes
    spacing : distance of neighbours, for each axis of `z` in its order (dy, dx for a map)
    nesting_index : L, same unit
    order : of the local polynomial, 0, 1 or 2

    Raises
    ------
    UsageError
        L is not larger than twice the spacing (nothing would be filtered), or order is unknown.

    """
    measured = np.isfinite(z)
    smooth = _regression(z, measured.astype(float), spacing, nesting_index, order)
    return np.where(measured, smooth, np.nan)


def robust_gaussian(
    z: Float, spacing: Sequence[float], nesting_index: float, *, order: int = 2
) -> Float:
    """Robust Gaussian regression filter: pits and peaks do not pull the smooth part.

    The weights delta are Tukey's biweight ``(1 - (r / c)^2)^2`` of the residuals r = z - w, with c
    4.4478 times their median absolute value, repeated until that settles [ISO 16610-31, -71].
    Arguments as of `gaussian`.
    """
    measured = np.isfinite(z)
    weight = measured.astype(float)
    before = np.inf
    smooth = np.full(z.shape, np.nan)
    for _ in range(MAX_ROBUST_ROUNDS):
        smooth = _regression(z, weight, spacing, nesting_index, order)
        residual = np.where(measured, z - smooth, np.nan)
        middle = float(np.nanmedian(np.abs(residual)))
        if not middle > 0.0 or abs(middle - before) <= ROBUST_SETTLED * middle:
            break
        before = middle
        share = np.minimum(np.abs(np.nan_to_num(residual)) / (TUKEY * middle), 1.0)
        weight = np.where(measured, (1.0 - share**2) ** 2, 0.0)
    return np.where(measured, smooth, np.nan)


def support(measured: Bool, spacing: Sequence[float], nesting_index: float) -> Float:
    """Share of the filter's weights that lies on measured cells: 1/2 on a straight end."""
    share = measured.astype(np.float64)
    for axis, step in enumerate(spacing):
        share = correlate1d(share, kernel(step, nesting_index)[1], axis=axis, mode="constant")
    return np.asarray(share)


def transmission(wavelength: Float, nesting_index: float) -> Float:
    """Amplitude that the Gaussian filter passes of a wave, ``exp(-pi (alpha L / l)^2)``."""
    return np.asarray(np.exp(-np.pi * (ALPHA * nesting_index / np.asarray(wavelength)) ** 2))


def kernel(spacing: float, nesting_index: float) -> tuple[Float, Float]:
    """Places from -L to L, in units of L, and the weights there, which add up to 1."""
    reach = int(np.floor(nesting_index / spacing))
    place = np.arange(-reach, reach + 1, dtype=np.float64) * (spacing / nesting_index)
    weights: Float = np.exp(-np.pi * (place / ALPHA) ** 2)
    return place, weights / weights.sum()


def _regression(
    z: Float, weight: Array, spacing: Sequence[float], nesting_index: float, order: int
) -> Float:
    """The value b0 of the local polynomials; nan where no weight is near.

    Sums ``sum_k s delta x^a y^b ...`` over the neighbours are separable: one correlation an axis.
    """
    if order not in (0, 1, 2):
        raise UsageError(f"{order=} but expected 0, 1 or 2")
    if not nesting_index > 2.0 * max(spacing):
        raise UsageError(
            f"a nesting index of {nesting_index:.4g} filters nothing on cells of "
            f"{max(spacing):.4g}: it must be more than two cells"
        )
    kernels = [kernel(step, nesting_index) for step in spacing]
    filled = np.where(np.isfinite(z), z, 0.0)
    cells = range(z.ndim)
    powers = [p for p in product(range(order + 1), repeat=z.ndim) if sum(p) <= order]
    powers.sort(key=sum)

    def moment(values: Float, power: tuple[int, ...]) -> Float:
        for axis, a in zip(cells, power, strict=True):
            place, s = kernels[axis]
            weights: Float = s * np.power(place, a)
            values = correlate1d(values, weights, axis=axis, mode="constant")
        return values

    sums = {
        total: moment(weight, total)
        for total in {tuple(map(sum, zip(p, q, strict=True))) for p in powers for q in powers}
    }
    heights = np.stack([moment(weight * filled, p) for p in powers], axis=-1)
    none = (0,) * z.ndim
    support = sums[none]
    if order == 0:
        with np.errstate(invalid="ignore", divide="ignore"):
            value = np.asarray(heights[..., 0] / support)
    else:
        normal = np.stack(
            [np.stack([sums[tuple(map(sum, zip(p, q, strict=True)))] for q in powers], axis=-1)
             for p in powers], axis=-2,
        )  # fmt: skip
        flat = np.diag([float(sum(p) > 0) for p in powers])
        normal += RIDGE * np.maximum(support, MIN_SUPPORT)[..., None, None] * flat
        normal[support <= MIN_SUPPORT] = np.eye(len(powers))
        value = np.asarray(np.linalg.solve(normal, heights[..., None])[..., 0, 0])
    return np.where(support > MIN_SUPPORT, value, np.nan)
