"""Known tilts as a prior of a refined model, where the images do not contradict them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from semsfm_colmap.geometry.rotations import rotation_angle
from semsfm_colmap.mapping.context import SeriesContext
from semsfm_colmap.motion.check import check_displacements, check_tilt
from semsfm_colmap.motion.combine import combine_tilt
from semsfm_colmap.records import TiltAgreement
from semsfm_colmap.refinement.displaced import Displacement
from semsfm_colmap.refinement.known_angles import stage_angle_prior
from semsfm_colmap.refinement.model_choice import total_rotation
from semsfm_colmap.refinement.refine import Refined, adjust_with_angles
from semsfm_colmap.refinement.trust import (
    covariance_of,
    noise_of_total_rotation,
    total_rotation_sigma,
    uncertainty_of,
)

TIGHT = 0.1
"""Standard deviation of angles that are to hold, in formal errors of the images."""


def with_known_tilt(
    context: SeriesContext, refined: Refined, displacement: Displacement
) -> tuple[Refined, TiltAgreement | None, list[str]]:
    """Adjust with the known tilt when the images agree with it; else say so and leave it out.

    The adjusted angles are those of the images, all stretched by one factor (`combine_tilt`): how
    they lie to one another the images know better than any stage. The error bars stay those of the
    images alone. What the camera models disagree on is not counted twice: `combine_tilt` has its
    own measure of what a change of magnification does to the angles.
    """
    tilt = context.tilt
    if tilt is None:
        return refined, None, []
    names = list(context.names_of(refined.images))
    height_px = context.height_px[refined.images]
    R = np.asarray(refined.cameras.cam_from_world)
    check = check_tilt(tilt, names, R)
    agreement = TiltAgreement(
        source=tilt.source,
        consistent=check.consistent,
        factor=None if np.isnan(check.factor) else check.factor,
        tolerance=None if np.isnan(check.tolerance) else check.tolerance,
    )
    known = stage_angle_prior(tilt, names)
    uncertainty = uncertainty_of(refined, height_px, displacement)
    if not check.consistent or known is None or uncertainty is None or np.isnan(check.factor):
        return refined, agreement, [check.message]
    combined = combine_tilt(check, total_rotation(R), total_rotation_sigma(refined, uncertainty))
    # the adjustment knows of no drift and no drag: what holds against it is measured by the noise
    own = covariance_of(refined, height_px, Displacement.none(len(height_px)))
    tight = uncertainty.noise if own is None else own
    a, b = known.pairs.T
    angles = replace(
        known,
        angle_rad=combined.stretch * rotation_angle(R[a] @ R[b].transpose(0, 2, 1)),
        sigma_rad=np.full(len(a), TIGHT * noise_of_total_rotation(refined, tight)),
    )
    adjusted = adjust_with_angles(refined, angles, context.refinement)
    agreement = replace(
        agreement, stretch=combined.stretch, weight=combined.weight, sigma=combined.sigma
    )
    note = (
        f"{check.message}; with a weight of {100 * combined.weight:.0f} % for the known tilts "
        f"({tilt.source}) the angles changed by {100 * (combined.stretch - 1):+.2f} %"
    )
    return adjusted, agreement, [note]


def displacement_notes(context: SeriesContext, refined: Refined) -> list[str]:
    """Whether the actuator's displacements follow the angles that the images show.

    Their factor is free, so that they say no more than how the angles lie to one another, and that
    the images know better: the model is the same with and without them.
    """
    if context.displacement_um is None:
        return []
    images = refined.images
    sentence = check_displacements(
        context.displacement_um[images],
        context.names_of(images),
        np.asarray(refined.cameras.cam_from_world),
    )
    return [] if sentence is None else [sentence]
