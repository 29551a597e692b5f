"""A flat specimen: no model without known tilts, since the images do not determine its angles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from semsfm_colmap.geometry.rotations import rotation_from_vector, vector_from_rotation
from semsfm_colmap.mapping.context import SeriesContext
from semsfm_colmap.motion.check import check_tilt
from semsfm_colmap.refinement.flatness import CLEAR_EXCESS, Flatness, flatness
from semsfm_colmap.refinement.known_angles import stage_angle_prior
from semsfm_colmap.refinement.refine import Refined, adjust_with_angles
from semsfm_colmap.types import Solution

MAX_MISFIT = 1.5
"""Known tilts that fit a plane leave residuals of its own size; so much larger ones contradict."""
TIGHT = 0.1
"""The images of a plane have no say in its angles: the known ones hold more tightly than stages
are right, in their standard deviations."""


def find_flat(first: Refined, last: Refined) -> Flatness | None:
    """Whether a model is flat to within the noise; None: it has depth, or nothing can be told.

    Parameters
    ----------
    first : the model of the matches alone
    last : the model that is to be written, which may be the same

    """
    found = flatness(last.cameras, last.points, last.observations)
    if found is None or not found.is_flat(CLEAR_EXCESS):
        return None
    limit = 1.0
    if last is not first:
        before = flatness(first.cameras, first.points, first.observations)
        if before is not None and before.is_flat():
            limit = CLEAR_EXCESS
    return found if found.is_flat(limit) else None


def settle_flat(context: SeriesContext, refined: Refined, found: Flatness) -> Solution[Refined]:
    """The model of a flat specimen with the known tilts; without any, the reason there is none."""
    if context.tilt is None:
        return Solution(value=None, status="planar", message=found.message)
    names = list(context.names_of(refined.images))
    known = stage_angle_prior(context.tilt, names)
    R = np.asarray(refined.cameras.cam_from_world)
    seen = check_tilt(context.tilt, names, R)
    if known is None or not abs(seen.factor) > 0.0:
        return Solution(value=None, status="planar", message=f"{found.message}; {seen.message}")
    # noise has set the angles: begin with the known ones
    turn = vector_from_rotation(R @ R[0].T) / abs(seen.factor)
    start = replace(refined.cameras, cam_from_world=rotation_from_vector(turn) @ R[0])
    known = replace(known, sigma_rad=TIGHT * known.sigma_rad)
    fit = adjust_with_angles(replace(refined, cameras=start), known, context.refinement)
    after = check_tilt(context.tilt, names, np.asarray(fit.cameras.cam_from_world))
    obs = fit.observations
    r = fit.cameras.project(fit.points[obs.track_idx], obs.image_idx) - obs.xy
    rms_px = float(np.sqrt(np.mean(r**2)))
    if not after.consistent or rms_px > MAX_MISFIT * refined.rms_px:
        message = (
            f"{found.message}; no plane turned by the known tilts ({context.tilt.source}) gives "
            f"these images: {rms_px:.2f} px are left instead of {refined.rms_px:.2f}, "
            f"{after.message}"
        )
        return Solution(value=None, status="planar", message=message)
    return Solution(value=replace(fit, rms_px=rms_px))


def flat_note(context: SeriesContext) -> str:
    """What to say of a model of a plane."""
    source = "known" if context.tilt is None else context.tilt.source
    return (
        "the specimen is flat to within the noise: its angles are those of the known tilts "
        f"({source}), the images do not determine them"
    )
