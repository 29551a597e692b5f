"""Whether a drift within the frames is a finding, or only what other errors look like.

A drift is an aspect and a skew of each frame's own, and takes up whatever else bends the images:
magnifications that a prior holds back, perspective, shading. It is a claim where

- it foretells: with it held-out residuals (`flatness.held_out_residuals`, every observation once)
  fall by more chi square a parameter than `MIN_GAIN`; independent noise gives 1,
  exact renders 1.0 and 1.3, photographs (perspective) 8, rendered scans with a drift of 0.2 px 15
  to 22;
- it is rough: a stage creeps and a specimen charges in each frame anew, but magnification, shading
  and perspective follow the tilt. The ratio of von Neumann, of half the mean square step from
  frame to frame to the variance, is 1 for independent drifts and 0 for a smooth course;
- the images were scanned: a header of a microscope or a databar says so, or the user. Others show
  no drift, unless it leaves no doubt.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from semsfm_colmap.refinement.adjustment import Adjustment, BundleSettings
from semsfm_colmap.refinement.bundle import bundle_adjust
from semsfm_colmap.refinement.flatness import held_out_residuals
from semsfm_colmap.refinement.model_choice import MAX_TRACKS, thin_tracks
from semsfm_colmap.refinement.scan_drift import adjust_with_drift
from semsfm_colmap.types import Float, Observations, OrthographicCameras

MIN_GAIN = 5.0
MIN_GAIN_UNKNOWN = 12.0
"""Fall of chi square a parameter, of scanned images and of those of which that is not known."""
MIN_ROUGHNESS = 0.2
MIN_ROUGHNESS_UNKNOWN = 0.5
"""Ratio of von Neumann below which a course is smooth; for independent drifts its standard
deviation is about 0.3 for ten frames, and shading adds a smooth course to true ones."""
MIN_FRAMES = 5
"""Of fewer frames nobody can say whether a course is smooth."""
CAP_SIGMAS = 4.0
"""Held-out residuals count up to so many standard deviations."""


@dataclass(frozen=True, kw_only=True)
class DriftClaim:
    """The evidence for a drift within the frames."""

    gain: float
    """fall of the held-out chi square for each parameter of the drift"""
    roughness: float
    """ratio of von Neumann; nan for too few frames"""
    scanned: bool
    """the images are known to come from a scanning instrument"""

    @property
    def holds(self) -> bool:
        """True where the drift is a finding."""
        if np.isnan(self.roughness):
            return self.scanned and self.gain > MIN_GAIN
        if self.scanned:
            return self.gain > MIN_GAIN and self.roughness > MIN_ROUGHNESS
        return self.gain > MIN_GAIN_UNKNOWN and self.roughness > MIN_ROUGHNESS_UNKNOWN


def roughness(course: Float) -> float:
    """Ratio of von Neumann of a course (M, k), its columns together; nan for a few frames."""
    if len(course) < MIN_FRAMES:
        return float("nan")
    variance = np.sum((course - course.mean(axis=0)) ** 2)
    return float(np.sum(np.diff(course, axis=0) ** 2) / (2.0 * max(variance, 1e-300)))


def judge_drift(
    cameras: OrthographicCameras,
    observations: Observations,
    height_px: Float,
    settings: BundleSettings,
    *,
    scanned: bool,
) -> DriftClaim:
    """Fits with and without a drift, compared.

    Parameters
    ----------
    cameras, observations : a converged fit and its inliers, in the order of acquisition
    height_px : (M,)

    """
    obs = thin_tracks(observations, MAX_TRACKS)
    still = bundle_adjust(cameras, obs, settings).value
    drifting = adjust_with_drift(cameras, obs, height_px, settings).value
    assert still is not None
    assert drifting is not None

    def chi_square(fit: Adjustment[Any]) -> float:
        A, _ = fit.model.cameras(fit.state.params)
        r = held_out_residuals(np.ascontiguousarray(A), np.asarray(fit.state.residuals), obs)
        square = np.nansum(r**2, axis=1) * obs.precision / settings.sigma_px**2
        return float(np.sum(np.minimum(square, CAP_SIGMAS**2)))

    course = drifting.state.params[1]
    return DriftClaim(
        gain=(chi_square(still) - chi_square(drifting)) / course.size,
        roughness=roughness(course),
        scanned=scanned,
    )
