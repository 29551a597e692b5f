"""How noisy the aligned observations are, learnt from the residuals of a first adjustment."""

from __future__ import annotations

import numpy as np

from semsfm_colmap.types import Float, Int

NUM_BINS = 12
"""Along each of the two predictors."""
MIN_RELATIVE_SIGMA = 0.5
MAX_RELATIVE_SIGMA = 5.0
MIN_PER_BIN = 30


def fit_relative_sigma(
    residuals: Float, share: Float, alignment_sigma_px: Float, baseline_sine: Float
) -> Float:
    """Standard deviation of each observation in units of the typical one: (O,).

    The variance of a coordinate is modelled as

        a^2 s^2 + b^2 + c^2 sin^2(baseline)

    s the formal standard deviation of the alignment (its shape is right, its size is not, for
    neighbouring pixels share their noise), b what every measurement has (row jitter, the reference
    patch), c the change of appearance with the angle between the views. The three are fitted,
    non-negative, to the medians of the squared residuals in bins of s and of the baseline: the
    median does not care about the outliers.

    Parameters
    ----------
    residuals : (O, 2) px
    share : (O,) expected share of the noise's variance left in each residual, see `noise_sigma`
    alignment_sigma_px, baseline_sine : (O,)

    """
    from scipy.optimize import nnls

    # the median of a squared Rayleigh variable is 2 ln 2 times the variance of a coordinate
    square = np.sum(residuals**2, axis=1) / (share * 2.0 * np.log(2.0))
    bins = _bin(alignment_sigma_px) * NUM_BINS + _bin(baseline_sine)
    rows, values, counts = [], [], []
    for k in np.unique(bins):
        mine = bins == k
        if mine.sum() < MIN_PER_BIN:
            continue
        rows.append(
            [np.median(alignment_sigma_px[mine] ** 2), 1.0, np.median(baseline_sine[mine] ** 2)]
        )
        values.append(np.median(square[mine]))
        counts.append(mine.sum())
    if len(rows) < 3:
        return np.ones(len(residuals))
    # relative errors of variances count alike
    weight = np.sqrt(counts) / np.maximum(values, 1e-12)
    coefficients, _ = nnls(np.array(rows) * weight[:, None], np.array(values) * weight)
    variance = (
        np.column_stack([alignment_sigma_px**2, np.ones(len(residuals)), baseline_sine**2])
        @ coefficients
    )
    typical = float(np.median(variance))
    if not typical > 0.0:
        return np.ones(len(residuals))
    return np.clip(np.sqrt(variance / typical), MIN_RELATIVE_SIGMA, MAX_RELATIVE_SIGMA)


def _bin(x: Float) -> Int:
    edges = np.quantile(x, np.linspace(0.0, 1.0, NUM_BINS + 1)[1:-1])
    return np.searchsorted(edges, x)
