"""The last adjustment of a guided pass: own weights if asked for, scan drift taken out."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from semsfm_colmap.geometry.eliminated import SolverOptions
from semsfm_colmap.matching.guided.grow import Grown
from semsfm_colmap.matching.guided.noise import fit_relative_sigma
from semsfm_colmap.refinement.noise import expected_share
from semsfm_colmap.refinement.options import RefinementOptions
from semsfm_colmap.refinement.refine import Refined, refine
from semsfm_colmap.refinement.scan_drift import adjust_with_drift, without_drift
from semsfm_colmap.types import Float, Observations


@dataclass(frozen=True, kw_only=True, eq=False)
class LastAdjustment:
    """What a guided pass ends with."""

    refined: Refined
    observations: Observations
    drift_px: Float
    """(num_images, 2) from the first row to the last; zero where none was sought"""


def adjust_last(
    grown: Grown,
    value: Refined,
    refinement: RefinementOptions,
    height_px: Float,
    *,
    own_weights: bool,
    rng: np.random.Generator,
    seed: int,
) -> LastAdjustment | None:
    """Adjust the observations as they would be in frames that were scanned at once.

    The drift within the frames is estimated with the cameras; it is then subtracted from the
    observations, to which the cameras are adjusted as usual: what is written agrees with itself,
    for programs too that know of no drift.

    Parameters
    ----------
    height_px : heights of all images of the series

    """
    observations = with_own_sigma(grown, value) if own_weights else grown.observations
    drift = np.zeros((observations.num_images, 2))
    if refinement.drift_sigma_px > 0.0:
        found = adjust_with_drift(
            value.cameras,
            value.observations,
            height_px[value.images],
            drift_sigma_px=refinement.drift_sigma_px,
            scale_sigma=refinement.scale_sigma,
            sigma_px=value.sigma_px,
            solver=SolverOptions(
                loss=refinement.last_loss,
                loss_width=refinement.loss_width,
                max_iterations=refinement.max_iterations,
            ),
        )
        assert found.value is not None
        drift[value.images] = found.value[1]
        i = observations.image_idx
        xy = without_drift(observations.xy, drift[i], height_px[i])
        # as a COLMAP database will hold them
        observations = replace(observations, xy=xy.astype(np.float32).astype(np.float64))
    last = refine(
        value.cameras,
        value.images,
        observations,
        replace(refinement, filter_thresholds_px=refinement.filter_thresholds_px[-1:]),
        rng=rng,
        seed=seed,
    )
    if last.value is None or len(last.value.images) < len(value.images):
        return None
    return LastAdjustment(refined=last.value, observations=observations, drift_px=drift)


def with_own_sigma(grown: Grown, value: Refined) -> Observations:
    """The observations with their relative standard deviations, learnt from the inliers."""
    obs = grown.observations
    length = np.bincount(obs.track_idx[value.inlier], minlength=obs.num_tracks)
    share = expected_share(
        length[obs.track_idx[value.inlier]], len(value.images), int(value.inlier.sum())
    )
    relative = fit_relative_sigma(
        np.asarray(value.state.residuals),
        share,
        grown.sigma_px[value.inlier],
        grown.baseline_sine[value.inlier],
    )
    full = np.ones(len(obs))
    full[value.inlier] = relative
    return replace(obs, relative_sigma=full)
