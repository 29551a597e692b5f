"""Scan drift and drag: estimated with the cameras, then taken out of the observations.

While a frame is scanned the specimen creeps, and shading pulls features down its slopes. Both are
estimated with the cameras (`refinement.displaced`) and subtracted from the observations, to which
the cameras are adjusted as usual: what is written agrees with itself, for programs too that know of
neither.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from semsfm_colmap.mapping.context import SeriesContext
from semsfm_colmap.records import DragFigures
from semsfm_colmap.refinement.adjustment import BundleSettings, comparing_solver, last_solver
from semsfm_colmap.refinement.displaced import (
    Displacement,
    find_displacement,
    without_displacement,
)
from semsfm_colmap.refinement.drift_claim import judge_drift
from semsfm_colmap.refinement.refine import Refined, adjust_again
from semsfm_colmap.types import Float, Observations

NOTED_DRIFT_PX = 0.1
"""Scan drift below this is not worth a sentence."""
NOTED_DRAG_PX = 0.1
"""A drag below this is not worth a sentence."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LastAdjustment:
    """A model of observations without drift and drag."""

    refined: Refined
    observations: Observations
    """of the whole series' images"""
    displacement: Displacement
    """what was taken out of them, of the images that are registered"""


def adjust_last(
    context: SeriesContext,
    value: Refined,
    observations: Observations,
) -> LastAdjustment:
    """Adjust to the observations as they would be in frames scanned at once, and without shading.

    Its inliers stay: drift and drag were estimated with them, and a selection that follows what
    was just taken out leaves the optimum that it was found at.
    """
    options = context.refinement
    settings = BundleSettings.of(options, value.sigma_px, last_solver(options))
    drifts = has_drift(context, value)
    found = find_displacement(
        value,
        context.height_px[value.images],
        settings if drifts else replace(settings, drift_sigma_px=0.0),
    )
    still = observations
    if found.drift_sigma_px > 0.0 or found.drag_px != 0.0:
        still = without_displacement(observations, found, value, context.height_px)
    last = adjust_again(value, still, options)
    # what is too small to be found may be there all the same: the error bars keep its prior
    sigma_px = 0.0 if options.scanned == "no" else options.drift_sigma_px
    found = replace(found, drift_sigma_px=sigma_px)
    return LastAdjustment(refined=last, observations=still, displacement=found)


def has_drift(context: SeriesContext, value: Refined) -> bool:
    """Whether a drift within the frames is a finding, see `refinement.drift_claim`."""
    options = context.refinement
    if options.drift_sigma_px <= 0.0 or options.scanned == "no":
        return False
    claim = judge_drift(
        value.cameras,
        value.observations,
        context.height_px[value.images],
        BundleSettings.of(options, value.sigma_px, comparing_solver(options)),
        scanned=context.is_scanned,
    )
    context.say(
        f"drift within the frames: held-out chi square falls by {claim.gain:.1f} a parameter, "
        f"roughness {claim.roughness:.2f}, {'' if claim.scanned else 'not '}known to be scanned: "
        f"{'taken out' if claim.holds else 'no finding'}"
    )
    return claim.holds


def drift_notes(drift_px: Float) -> list[str]:
    """What to say of the scan drift taken out of a part."""
    largest = float(np.abs(drift_px).max(initial=0.0))
    if largest < NOTED_DRIFT_PX:
        return []
    return [
        "the specimen drifted while the frames were scanned, the last row against the first by up "
        f"to {largest:.2f} px; the observations are given as they would be without (drift_px)"
    ]


def drag_notes(drag: DragFigures | None) -> list[str]:
    """What to say of the drag taken out of a part."""
    if drag is None or abs(drag.coefficient_px) < max(NOTED_DRAG_PX, 2.0 * drag.sigma_px):
        return []
    c, sigma = drag.coefficient_px, drag.sigma_px
    return [
        f"shading drags features {'down' if c > 0 else 'up'} the slopes of the specimen, by up to "
        f"{0.5 * abs(c):.2f} px (coefficient {c:.2f} +- {sigma:.2f} px); the observations are "
        "given as they would be without (drag)"
    ]
