"""The noise of a measurement, from the residuals of a fit.

A fit with u unknowns to n numbers leaves residuals whose squares sum to (n - u) sigma^2: 3 of the
2 k numbers of a track of k observations go into its point, 6 an image into the cameras.
"""

from __future__ import annotations

import numpy as np

from semsfm_colmap.refinement.noise_kernels import sums_within
from semsfm_colmap.types import Float, Int

TAIL = 4.5
"""Gaussian noise in two coordinates exceeds this many sigma once in 25,000 times."""
MIN_SIGMA_PX = 0.02
"""No real measurement is better; keeps the balance with the priors finite on exact data."""
MEDIAN_SAMPLE = 200_000
"""Residuals that tell where the tail begins: their median is known to 0.2 %."""


def expected_share(track_length: Int, num_images: int, num_observations: int) -> Float:
    """The share of the noise's variance that a fit leaves in a residual, by the track's length."""
    camera_share = 3.0 * num_images / num_observations
    return np.maximum(1.0 - 1.5 / np.maximum(track_length, 2) - camera_share, 0.05)


def noise_sigma(r: Float, precision: Float, pointer: Int, num_images: int) -> float:
    """Standard deviation per coordinate from residuals (O, 2), corrected for the fit.

    Residuals beyond TAIL robust standard deviations have no say.

    Parameters
    ----------
    r, precision : (O, 2) px, (O,) relative weights; sorted by track
    pointer : (N + 1,) where each track begins

    """
    length = np.diff(pointer)
    share = expected_share(length, num_images, len(r))
    some = np.arange(len(r))
    if len(r) > MEDIAN_SAMPLE:
        some = np.sort(np.random.default_rng(0).integers(0, len(r), MEDIAN_SAMPLE))
    track = np.searchsorted(pointer, some, side="right") - 1
    norm2 = np.sum(r[some] ** 2, axis=1) * precision[some] / share[track]
    # the median of a Rayleigh distribution is sqrt(2 ln 2) sigma
    first = np.sqrt(np.median(norm2) / (2.0 * np.log(2.0)))
    limit = (TAIL * max(first, 1e-12)) ** 2
    squares, expected = sums_within(r, precision, pointer, share, limit)
    return max(float(np.sqrt(squares / (2.0 * expected))), MIN_SIGMA_PX)
