"""Verification of one pair: static motion -> affine epipolar geometry -> distance filter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from semsfm_colmap.geometry.epipolar import epipolar_residual, estimate_affine_fundamental
from semsfm_colmap.matching.filters import distance_filter, static_matches
from semsfm_colmap.matching.options import MatchingOptions
from semsfm_colmap.matching.ransac import find_affine_fundamental
from semsfm_colmap.records import MATCH_STEPS
from semsfm_colmap.types import AffineTwoViewGeometry, Float, Int

STATIC, EPIPOLAR, DISTANCE, VERIFIED = range(len(MATCH_STEPS))


@dataclass(frozen=True, kw_only=True, eq=False)
class PairVerifier:
    """`verify_pair` with all that pairs have in common; can be pickled, for other processes."""

    keypoints: Sequence[Float]
    """(K, 2) px of each image"""
    options: MatchingOptions
    seed: int

    def __call__(self, pair: tuple[tuple[int, int], Int]) -> AffineTwoViewGeometry:
        """Verify a pair: numbers in `keypoints`, and its matches (L, 2)."""
        (i, j), rows = pair
        return verify_pair(
            (i, j), self.keypoints[i], self.keypoints[j], rows, self.options, self.seed
        )


def verify_pair(
    image_pair: tuple[int, int],
    keypoints1: Float,
    keypoints2: Float,
    matches: Int,
    options: MatchingOptions,
    seed: int,
) -> AffineTwoViewGeometry:
    """Affine two-view geometry of a pair.

    Parameters
    ----------
    keypoints1, keypoints2 : (K, 2) px
    matches : (L, 2) keypoint indices
    seed : the result depends on it and on the pair alone

    """
    rng = np.random.default_rng([seed, *image_pair])
    L = len(matches)
    xy1 = keypoints1[matches[:, 0]] if L else np.zeros((0, 2))
    xy2 = keypoints2[matches[:, 1]] if L else np.zeros((0, 2))
    rejected: dict[str, int] = {}
    static = static_matches(xy2 - xy1, options.static_radius_px, options.static_excess)
    rejected["static"] = int(static.sum())
    moving = np.flatnonzero(~static)
    step = np.where(static, STATIC, EPIPOLAR)
    found = find_affine_fundamental(
        xy1[moving],
        xy2[moving],
        max_error_px=options.max_error_px,
        min_num_inliers=options.min_num_inliers,
        trials=options.ransac_trials,
        rng=rng,
    )
    inlier = np.zeros(L, dtype=bool)
    residual = np.full(L, np.nan)
    if found.value is None:
        return AffineTwoViewGeometry(
            image_pair=image_pair,
            keypoints=matches,
            F=None,
            inlier=inlier,
            residual_px=residual,
            rejected_by=rejected,
            failure=found.message,
            step=step,
        )
    F, agree = found.value
    supporters = moving[agree]
    step[supporters] = DISTANCE
    rejected["epipolar"] = int(len(moving) - len(supporters))
    near = distance_filter(xy2[supporters] - xy1[supporters], options.distance_filter_sigmas)
    rejected["distance"] = int(np.sum(~near))
    supporters = supporters[near]
    F = estimate_affine_fundamental(xy1[supporters], xy2[supporters])
    residual = epipolar_residual(F, xy1, xy2)
    inlier[supporters] = np.abs(residual[supporters]) < options.max_error_px
    step[inlier] = VERIFIED
    return AffineTwoViewGeometry(
        image_pair=image_pair,
        keypoints=matches,
        F=F,
        inlier=inlier,
        residual_px=residual,
        rejected_by=rejected,
        step=step,
    )
