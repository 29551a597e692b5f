"""Affine epipolar geometry from contaminated matches: 4-point LO-RANSAC.

Four correspondences fix the hyperplane (`geometry.epipolar`). All samples are scored at once with
the truncated squared distance (MSAC, Torr and Zisserman 2000); the best ones are refined by least
squares on their inliers with a shrinking threshold (locally optimised RANSAC, Chum et al. 2003).

One equation per match is a weak test: in a pair that shows nothing in common some matches satisfy
it by chance. How many, is measured on the pair itself with its correspondences shuffled, and a
geometry is accepted only if chance explains its inliers in less than one pair of a thousand
(a-contrario, Moisan and Stival 2004).
"""

from __future__ import annotations

import numpy as np
from scipy.special import gammaln
from scipy.stats import binom

from semsfm_colmap.geometry.epipolar import fundamental_from_hyperplane
from semsfm_colmap.matching.ransac_kernels import optimise_hyperplanes
from semsfm_colmap.types import Bool, Float, Solution

BATCH = 100
"""Samples scored at once."""
CLEAR_SHARE = 0.6
"""A share of inliers that ends the search: 100 samples then miss with probability 1e-6."""
NUM_REFINED = 5
"""Samples that are locally optimised."""
SHRINK = (3.0, 2.0, 1.5, 1.0, 1.0)
"""Thresholds of the local optimisation, in units of the final one."""
MAX_LOG_FALSE_ALARMS = np.log(1e-3)


def hyperplanes_from_samples(points: Float) -> tuple[Float, Float]:
    """Unit normals (T, 4) and offsets (T,) through four points each: (T, 4, 4) -> ...

    The normal is the generalised cross product of the three difference vectors.
    """
    d = points[:, 1:] - points[:, :1]
    a, b, c = d[:, 0], d[:, 1], d[:, 2]
    n = np.empty((len(points), 4))
    for k in range(4):
        keep = [m for m in range(4) if m != k]
        minor = np.einsum("ti,ti->t", a[:, keep], np.cross(b[:, keep], c[:, keep]))
        n[:, k] = (-1.0) ** k * minor
    norm = np.linalg.norm(n, axis=1)
    n /= np.maximum(norm, 1e-300)[:, None]
    n[norm < 1e-9] = 0.0
    return n, -np.einsum("tk,tk->t", n, points[:, 0])


def log_false_alarms(num_inliers: int, num_matches: int, chance: float) -> float:
    """Logarithm of the expected number of accidental geometries with so many inliers.

    Each of the ``C(L, 4)`` samples is one test; the other matches agree with probability `chance`.
    """
    rest, agree = num_matches - 4, num_inliers - 4
    if agree <= 0:
        return 0.0
    log_tests = gammaln(num_matches + 1) - gammaln(5) - gammaln(num_matches - 3)
    return float(log_tests + binom.logsf(agree - 1, rest, min(max(chance, 1e-6), 1.0)))


def _best_samples(
    centred: Float, max_error_px: float, trials: int, rng: np.random.Generator
) -> tuple[Float, Float]:
    """The best of random samples, by truncated squared distance of all matches (L, 4).

    Returns
    -------
    normals (S, 4), offsets (S,)

    """
    L, limit = len(centred), max_error_px**2
    n, e, cost = np.zeros((0, 4)), np.zeros(0), np.zeros(0)
    while len(cost) < trials:
        pick = rng.integers(0, L, size=(min(BATCH, trials - len(cost)), 4))
        normal, offset = hyperplanes_from_samples(centred[pick])
        distance2 = (centred @ normal.T + offset) ** 2  # (L, BATCH)
        truncated = np.minimum(distance2, limit).sum(axis=0)
        truncated[~np.any(normal != 0.0, axis=1)] = np.inf
        n, e = np.concatenate([n, normal]), np.concatenate([e, offset])
        cost = np.concatenate([cost, truncated])
        # a share w of inliers makes a batch without a clean sample as rare as (1 - w^4)^BATCH
        if np.min(cost) < (1.0 - CLEAR_SHARE) * L * limit:
            break
    chosen = np.argsort(cost, kind="stable")[:NUM_REFINED]
    return n[chosen], e[chosen]


def find_affine_fundamental(
    xy1: Float,
    xy2: Float,
    *,
    max_error_px: float,
    min_num_inliers: int,
    trials: int,
    rng: np.random.Generator,
) -> Solution[tuple[Float, Bool]]:
    """Affine F and its inliers among matches, or why there is none.

    Parameters
    ----------
    xy1, xy2 : (L, 2) px
    max_error_px : distance to the constraint up to which a match is an inlier

    Returns
    -------
    Solution of (F (3, 3), inlier (L,))

    """
    L = len(xy1)
    if max(min_num_inliers, 5) > L:
        return Solution(value=None, status="too_few_matches", message=f"only {L} matches")
    data = np.column_stack([xy1, xy2])
    centre = data.mean(axis=0)
    centred = data - centre
    normals, offsets = _best_samples(centred, max_error_px, trials, rng)
    thresholds = max_error_px * np.array(SHRINK)
    score = optimise_hyperplanes(centred, normals, offsets, thresholds, max_error_px**2)
    best = int(np.argmin(score))
    normal, offset = normals[best], float(offsets[best])
    first, second = centred[:, :2] @ normal[:2], centred[:, 2:] @ normal[2:] + offset
    inlier = np.abs(first + second) < max_error_px
    count = int(inlier.sum())
    shuffled = np.abs(np.concatenate([first + second[rng.permutation(L)] for _ in range(4)]))
    chance = (np.sum(shuffled < max_error_px) + 1.0) / (len(shuffled) + 1.0)
    diagnostics = {"num_inliers": count, "chance": chance}
    if count < min_num_inliers:
        return Solution(
            value=None,
            status="too_few_inliers",
            message=f"only {count} of {L} matches agree on an affine epipolar geometry",
            diagnostics=diagnostics,
        )
    if log_false_alarms(count, L, chance) > MAX_LOG_FALSE_ALARMS:
        return Solution(
            value=None,
            status="accidental",
            message=f"{count} of {L} matches agree, which chance explains",
            diagnostics=diagnostics,
        )
    # undo the centring: n . (x - centre) + e
    F = fundamental_from_hyperplane(normal, offset - float(normal @ centre))
    return Solution(value=(F, inlier), diagnostics=diagnostics)
