"""Is there perspective? The rung of the ladder with one inverse distance, against the plain one.

Perspective is found where the Bayesian information criterion and residuals at observations that the
fit has not seen speak for it, against cameras that have as much freedom of magnification, and kappa
is many of its standard deviations, clustered errors and confusion with drag in them. It is used,
that is taken out of the observations, where the residuals fall as clearly as rules a rung out, or
where kappa is beyond doubt and changes the total rotation.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from semsfm_colmap.geometry.points import residuals
from semsfm_colmap.records import PerspectiveFigures, Rung
from semsfm_colmap.refinement.adjustment import Adjustment, BundleSettings
from semsfm_colmap.refinement.bundle import adjust, bundle_adjust, plain_model
from semsfm_colmap.refinement.covariance import camera_covariance
from semsfm_colmap.refinement.drag import MIN_POINTS, DragModel
from semsfm_colmap.refinement.model_choice import (
    MAX_TRACKS,
    MIN_DISAGREEMENT,
    held_out_mask,
    thin_tracks,
    total_rotation,
)
from semsfm_colmap.refinement.perspective import PerspectiveFit, fit_perspective
from semsfm_colmap.refinement.uncertainty import clustered_modes, shared_mode, surface_patches
from semsfm_colmap.types import Float, Observations, OrthographicCameras

PERSPECTIVE_RUNG = "perspective"
MIN_SIGMAS = 5.0
"""kappa is found when it is so many of its standard deviations."""
MIN_BIC_GAIN = 10.0
"""Very strong evidence on the usual scale (Kass and Raftery 1995)."""
CERTAIN_SIGMAS = 10.0
"""So many are no chance; whether they matter, the total rotation says."""
CLEAR_FALL = 1.05
"""The factor of held-out residuals that rules out a rung of the ladder."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PerspectiveChoice:
    """The rung with perspective, and what to think of it."""

    rung: Rung
    """without drag beside it, like the others of the ladder"""
    kappa: float
    """1/px"""
    sigma: float
    """its standard deviation, 1/px"""
    radius_px: float
    change_deg: float
    """of the total rotation, against the plain rung with the drag beside it"""
    found: bool
    clear: bool
    """found, and parallel projection is ruled out, or wrong by more than a percent"""
    fit: PerspectiveFit

    def figures(self, *, used: bool) -> PerspectiveFigures:
        """For the record."""
        return PerspectiveFigures(
            kappa_per_px=self.kappa,
            sigma_per_px=self.sigma,
            distance_px=1.0 / self.kappa,
            distance_radii=1.0 / (self.kappa * self.radius_px),
            deviation_px=abs(self.kappa) * self.radius_px**2,
            change_deg=self.change_deg,
            used=used,
        )


def choose_perspective(
    cameras: OrthographicCameras,
    observations: Observations,
    principal_px: Float,
    settings: BundleSettings,
) -> PerspectiveChoice | None:
    """Fit with and without perspective, compare; None with too few points or nothing to compare.

    Parameters
    ----------
    cameras : a converged fit, about 1 px per unit
    observations : inliers, sorted by track
    principal_px : (M, 2) where the optical axis meets each image

    """
    obs = thin_tracks(observations, MAX_TRACKS)
    out = held_out_mask(obs)
    kept, held = obs.select(~out), obs.select(out)
    if obs.num_tracks < MIN_POINTS or not len(held):
        return None
    start = bundle_adjust(cameras, kept, replace(settings, camera_model="scaled_orthographic"))
    assert start.value is not None
    begin = start.value
    fit = fit_perspective(
        begin.cameras, begin.points, kept, principal_px, settings, beside_drag=True
    )
    rivals = []
    for scale_sigma in (settings.scale_sigma, fit.scale_sigma):
        model = DragModel.build(
            plain_model(len(cameras), scale_sigma), begin.cameras, begin.points, kept
        )
        rival = adjust(model, (begin.cameras, 0.0), kept, settings).value
        assert rival is not None
        rivals.append(rival)
    own = rung_of(fit.adjustment, kept, fit.residuals(held))
    alone = fit_perspective(begin.cameras, begin.points, kept, principal_px, settings)
    others = [rung_of(rival, kept, plain_residuals(rival, held)) for rival in rivals]
    sigma = kappa_sigma(fit, kept, settings.sigma_px)
    least = min(rung.held_out_px for rung in others)
    found = (
        own.bic < min(rung.bic for rung in others) - MIN_BIC_GAIN
        and own.held_out_px < least
        and abs(fit.kappa) > MIN_SIGMAS * sigma
    )
    change_deg = own.range_deg - others[0].range_deg
    certain = abs(fit.kappa) > CERTAIN_SIGMAS * sigma
    matters = abs(change_deg) > MIN_DISAGREEMENT * own.range_deg
    falls = CLEAR_FALL * own.held_out_px < least
    return PerspectiveChoice(
        rung=rung_of(alone.adjustment, kept, alone.residuals(held)),
        kappa=fit.kappa,
        sigma=sigma,
        radius_px=fit.radius_px,
        change_deg=change_deg,
        found=found,
        clear=found and (falls or (certain and matters)),
        fit=fit,
    )


def plain_residuals(fit: Adjustment[Any], held: Observations) -> Float:
    """Residuals of a model with drag at observations it has not seen: (O, 2) px."""
    model: Any = fit.model
    A, t = model.cameras(fit.state.params)
    xy = held.xy - model.displacement(fit.state.params, held.image_idx, held.track_idx)
    return residuals(A, t, fit.state.X, held.image_idx, held.track_idx, xy)


def rung_of(fit: Adjustment[Any], kept: Observations, held_out: Float) -> Rung:
    """The figures by which rungs are compared."""
    R = np.asarray(fit.cameras.cam_from_world)
    return Rung(
        name=PERSPECTIVE_RUNG,
        range_deg=float(np.rad2deg(total_rotation(R))),
        bic=float(fit.state.cost + fit.model.num_params * np.log(2 * len(kept))),
        held_out_px=float(np.sqrt(np.median(held_out**2))),
        num_parameters=fit.model.num_params,
    )


def kappa_sigma(fit: PerspectiveFit, observations: Observations, sigma_px: float) -> float:
    """Standard deviation of kappa: noise, drag, and what patches err in together; inf: unknown."""
    model, state = fit.model, fit.adjustment.state
    cameras = camera_covariance(model, state, observations, sigma_px)
    if cameras is None:
        return float("inf")
    patch = surface_patches(fit.adjustment.points)
    clustered = clustered_modes(model, state, observations, sigma_px, cameras, patch)[-1]
    _, formal = shared_mode(cameras, model.num_params - 1)
    return float(np.sqrt(formal**2 + clustered @ clustered))
