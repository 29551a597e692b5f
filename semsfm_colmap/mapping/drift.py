"""The last adjustment of a guided pass: own weights if asked for, drift and drag taken out."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from semsfm_colmap.geometry.eliminated import SolverOptions
from semsfm_colmap.matching.guided.grow import Grown
from semsfm_colmap.matching.guided.noise import fit_relative_sigma
from semsfm_colmap.refinement.displaced import (
    Displacement,
    find_displacement,
    without_displacement,
)
from semsfm_colmap.refinement.noise import expected_share
from semsfm_colmap.refinement.options import RefinementOptions
from semsfm_colmap.refinement.refine import CHI_SQUARE_TOLERANCE, Refined, refine
from semsfm_colmap.types import Float, Observations


@dataclass(frozen=True, kw_only=True, eq=False)
class LastAdjustment:
    """What a guided pass ends with."""

    refined: Refined
    observations: Observations
    displacement: Displacement
    """what was taken out of them, of the images that are registered"""


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

    The drift within the frames and the drag of the shading are estimated with the cameras; they are
    then subtracted from the observations, to which the cameras are adjusted as usual: what is
    written agrees with itself, for programs too that know of neither.

    Parameters
    ----------
    height_px : heights of all images of the series

    """
    observations = with_own_sigma(grown, value) if own_weights else grown.observations
    found = find_displacement(
        value,
        height_px[value.images],
        drift_sigma_px=refinement.drift_sigma_px,
        drag_sigma_px=refinement.drag_sigma_px,
        scale_sigma=refinement.scale_sigma,
        solver=SolverOptions(
            loss=refinement.last_loss,
            loss_width=refinement.loss_width,
            max_iterations=refinement.max_iterations,
            absolute_tolerance=CHI_SQUARE_TOLERANCE,
        ),
    )
    if found.drift_sigma_px > 0.0 or found.drag_px != 0.0:
        observations = without_displacement(observations, found, value, height_px)
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
    drift = np.zeros((observations.num_images, 2))
    drift[value.images] = found.drift_px
    found = replace(found, drift_px=drift[last.value.images])
    return LastAdjustment(refined=last.value, observations=observations, displacement=found)


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
