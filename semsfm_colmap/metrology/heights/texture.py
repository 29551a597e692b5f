"""Spatial parameters: how far heights are alike, and in which direction the texture runs."""

from __future__ import annotations

import numpy as np
from scipy import fft
from scipy.ndimage import map_coordinates

from semsfm_colmap.types import Array, Float

DECAY = 0.2
"""s: the autocorrelation that Sal and Str ask for [default of ISO 25178-3]."""
ANGLE_STEP_DEG = 1.0
RAY_STEP = 0.25
"""Of a cell, along the rays that look for the decay."""
MAX_LAG = 0.5
"""Share of the map's size that lags reach: beyond, few pairs of cells are left."""
HALF_LOBE = 5
"""Steps of the angle on either side of the strongest direction that tell its centre."""
MIN_PAIRS = 0.1
"""Share of the cells that must have a partner at a lag."""


def autocorrelation(z: Float) -> Float:
    """Correlation of z(x) with z(x + t) over the pairs of measured cells.

        f(t) = sum z(x) z(x + t) / sqrt(sum z(x)^2 sum z(x + t)^2)

    The sums go over the same pairs, so that holes and edges have no influence: a wave keeps its
    amplitude at every lag, where a sum over all cells would lose it with the overlap.

    Returns
    -------
    (2 R + 1, 2 C + 1) with lag 0 in the middle; R, C half of the rows and columns; nan where too
    few pairs are left

    """
    measured = np.isfinite(z)
    away = np.where(measured, z - np.mean(z[measured]), 0.0)
    shape = [fft.next_fast_len(2 * n, real=True) for n in z.shape]

    there, value, square = (
        fft.rfft2(a, shape) for a in (measured.astype(float), away, away * away)
    )

    def correlated(a: Array, b: Array) -> Float:
        return np.asarray(fft.irfft2(np.conj(a) * b, shape))

    pairs = np.rint(correlated(there, there))
    power = correlated(there, square) * correlated(square, there)
    reach = [int(MAX_LAG * n) for n in z.shape]
    pick = np.ix_(*(np.arange(-r, r + 1) for r in reach))
    enough = pairs[pick] >= MIN_PAIRS * measured.sum()
    with np.errstate(invalid="ignore", divide="ignore"):
        f = correlated(value, value)[pick] / np.sqrt(power[pick])
    return np.where(enough, f, np.nan)


def decay_lengths(z: Float, spacing: tuple[float, float]) -> tuple[Float, Float]:
    """Distance at which the autocorrelation has fallen to s = 0.2, by direction.

    Walks outward from lag 0 and takes the first crossing, between two samples on a straight line.

    Returns
    -------
    angle : (K,) degrees from x toward y, 0 to below 180
    length : (K,) same unit as the spacing; inf where it does not fall so far within the map

    """
    f = autocorrelation(z)
    middle = [n // 2 for n in f.shape]
    dx, dy = spacing
    angle = np.arange(0.0, 180.0, ANGLE_STEP_DEG)
    step = RAY_STEP * min(dx, dy)
    num = int(np.hypot(middle[1] * dx, middle[0] * dy) / step) + 1
    r = np.arange(num + 1) * step
    x = np.cos(np.radians(angle))[:, None] * r / dx + middle[1]
    y = np.sin(np.radians(angle))[:, None] * r / dy + middle[0]
    filled = np.where(np.isfinite(f), f, 0.0)
    value = map_coordinates(filled, [y, x], order=3, mode="constant", cval=np.nan)
    known = map_coordinates(np.isfinite(f).astype(float), [y, x], order=0, mode="constant")
    value = np.where(known > 0.5, value, np.nan)
    length = np.full(len(angle), np.inf)
    for k, row in enumerate(value):
        end = np.flatnonzero(~(row >= DECAY))
        if len(end) and np.isfinite(row[end[0]]):
            i = int(end[0])
            length[k] = r[i - 1] + step * (row[i - 1] - DECAY) / (row[i - 1] - row[i])
    return angle, length


def texture_direction(z: Float, spacing: tuple[float, float]) -> float:
    """Std: direction in which the texture runs, degrees from x toward y, 0 to below 180.

    The angular spectrum ``a(theta) = integral of r |F(r, theta)|^2 dr`` of the map under a Hann
    window, holes at the mean, has its maximum across the lay: Std is that angle plus 90 degrees.
    """
    measured = np.isfinite(z)
    away = np.where(measured, z - np.mean(z[measured]), 0.0)
    window = np.outer(np.hanning(z.shape[0]), np.hanning(z.shape[1]))
    power = np.abs(fft.fft2(away * window)) ** 2
    fy, fx = np.meshgrid(
        fft.fftfreq(z.shape[0], spacing[1]), fft.fftfreq(z.shape[1], spacing[0]), indexing="ij"
    )
    r = np.hypot(fx, fy)
    # waves longer than half of the map tell no direction, those beyond Nyquist not all directions
    low = 2.0 / min(z.shape[0] * spacing[1], z.shape[1] * spacing[0])
    counts = (r > low) & (r <= 0.5 / max(spacing))
    # area elements in polar coordinates are r dr dtheta: the sum over cells has the r in it
    bins = np.round(np.degrees(np.arctan2(fy, fx))[counts] / ANGLE_STEP_DEG).astype(int)
    num = round(180.0 / ANGLE_STEP_DEG)
    total = np.bincount(bins % num, power[counts], minlength=num)
    # neighbouring directions share their waves: the centre of the strongest few
    near = np.arange(-HALF_LOBE, HALF_LOBE + 1)
    lobe = np.hanning(len(near) + 2)[1:-1]
    around = lobe * total[(np.arange(num)[:, None] + near) % num]
    best = int(np.argmax(around.sum(axis=1)))
    centre = best + float(around[best] @ near) / float(around[best].sum())
    return (centre * ANGLE_STEP_DEG + 90.0) % 180.0
