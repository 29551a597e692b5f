"""Scan drift: estimated with the cameras, then taken out of the observations.

While a frame is scanned the specimen creeps; the drift within the frames is estimated with the
cameras (`refinement.scan_drift`) and subtracted from the observations, to which the cameras are
adjusted as usual: what is written agrees with itself, for programs too that know of no drift.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from semsfm_colmap.mapping.context import SeriesContext
from semsfm_colmap.refinement.adjustment import BundleSettings, last_solver
from semsfm_colmap.refinement.refine import Refined, refine
from semsfm_colmap.refinement.scan_drift import adjust_with_drift, without_drift
from semsfm_colmap.types import Float, Observations

NOTED_DRIFT_PX = 0.1
"""Scan drift below this is not worth a sentence."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LastAdjustment:
    """A model of observations without drift."""

    refined: Refined
    observations: Observations
    """of the whole series' images"""
    drift_px: Float
    """(num_images, 2) what was taken out, from the first row to the last"""


def adjust_last(
    context: SeriesContext,
    value: Refined,
    observations: Observations,
    *,
    rng: np.random.Generator,
) -> LastAdjustment | None:
    """Adjust the observations as they would be in frames that were scanned at once.

    None where that leaves fewer images.
    """
    drift_px = estimate_drift(context, value)
    still = take_out_drift(context, observations, drift_px)
    options = context.refinement
    last = refine(
        value.cameras,
        value.images,
        still,
        replace(options, filter_thresholds_px=options.filter_thresholds_px[-1:]),
        rng=rng,
        seed=context.seed,
    ).value
    if last is None or len(last.images) < len(value.images):
        return None
    return LastAdjustment(refined=last, observations=still, drift_px=drift_px)


def estimate_drift(context: SeriesContext, value: Refined) -> Float:
    """(M, 2) displacement of the last row against the first, of all images of the series, px.

    Zero where the options ask for none, and in images that are not registered.
    """
    options = context.refinement
    drift = np.zeros((len(context.image_names), 2))
    if options.drift_sigma_px > 0.0:
        # to the last digit: what is left of it would stay in the observations
        solver = replace(last_solver(options), absolute_tolerance=0.0)
        found = adjust_with_drift(
            value.cameras,
            value.observations,
            context.height_px[value.images],
            BundleSettings.of(options, value.sigma_px, solver),
        )
        assert found.value is not None
        drift[value.images] = found.value.state.params[1]
    return drift


def take_out_drift(
    context: SeriesContext, observations: Observations, drift_px: Float
) -> Observations:
    """The observations as they would be in frames that were scanned at once."""
    if context.refinement.drift_sigma_px <= 0.0:
        return observations
    i = observations.image_idx
    xy = without_drift(observations.xy, drift_px[i], context.height_px[i])
    # as a COLMAP database will hold them
    return replace(observations, xy=xy.astype(np.float32).astype(np.float64))


def drift_notes(drift_px: Float) -> list[str]:
    """What to say of the scan drift taken out of a part."""
    largest = float(np.abs(drift_px).max(initial=0.0))
    if largest < NOTED_DRIFT_PX:
        return []
    return [
        "the specimen drifted while the frames were scanned, the last row against the first by up "
        f"to {largest:.2f} px; the observations are given as they would be without (drift_px)"
    ]
