"""How far to trust a model: error bars, the ladder of camera models, leave-one-image-out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from semsfm_colmap.geometry.eliminated import Eliminated
from semsfm_colmap.geometry.rotations import vector_from_rotation
from semsfm_colmap.motion.small_tilt import SMALL_ROTATION_DEG
from semsfm_colmap.records import LeftOut, Reliability, ScanDriftFigures
from semsfm_colmap.refinement.adjustment import BundleSettings, comparing_solver
from semsfm_colmap.refinement.covariance import Covariance, estimate_covariance
from semsfm_colmap.refinement.leave_one_out import leave_one_out
from semsfm_colmap.refinement.model_choice import (
    DRIFT_RUNG,
    MAX_TRACKS,
    ModelComparison,
    compare_models,
    thin_tracks,
    total_rotation,
    widest_pair,
)
from semsfm_colmap.refinement.options import RefinementOptions
from semsfm_colmap.refinement.refine import Refined
from semsfm_colmap.refinement.scan_drift import ScanDriftModel
from semsfm_colmap.types import Float

MIN_UNCERTAINTY = 0.01
"""A spread of the camera models below one percent is not worth a sentence."""


def covariance_of(refined: Refined, height_px: Float, drift_sigma_px: float) -> Covariance | None:
    """Error bars of a refined model.

    Where scan drift was taken out of the observations it is not known any better than it was
    estimated: the error bars are those of the model that has it, at no drift.

    Parameters
    ----------
    height_px : (M,) heights of the images registered
    drift_sigma_px : prior of the drift; 0 where none was sought

    """
    found, obs, sigma_px = refined.adjustment, refined.observations, refined.sigma_px
    if drift_sigma_px <= 0.0:
        return estimate_covariance(found.model, found.state, obs, sigma_px).value
    model = ScanDriftModel.build(found.model, drift_sigma_px, height_px)
    state: Eliminated[Any] = found.state
    state = replace(state, params=(found.state.params, np.zeros((len(height_px), 2))))
    return estimate_covariance(model, state, obs, sigma_px).value


def reliability(
    refined: Refined,
    covariance: Covariance | None,
    options: RefinementOptions,
    height_px: Float,
    names: Sequence[str],
    *,
    tilt_known: bool,
) -> tuple[Reliability, list[str]]:
    """Total rotation with its error bar, the ladder of models, leave-one-out; and what they say.

    Parameters
    ----------
    names : of the images registered

    """
    settings = BundleSettings.of(options, refined.sigma_px, comparing_solver(options))
    sigma_deg = 0.0
    range_deg = float(np.rad2deg(total_rotation(np.asarray(refined.cameras.cam_from_world))))
    if covariance is not None:
        sigma_deg = float(np.rad2deg(total_rotation_sigma(refined, covariance)))
    comparison = compare_models(
        refined.cameras,
        refined.observations,
        settings,
        range_sigma_rad=np.deg2rad(sigma_deg),
        height_px=height_px if options.drift_sigma_px > 0.0 else None,
    )
    jackknife = leave_one_out(
        refined.cameras, thin_tracks(refined.observations, MAX_TRACKS), settings
    )
    drift = largest_drift_px(comparison)
    figures = Reliability(
        total_rotation_deg=range_deg,
        total_rotation_sigma_deg=sigma_deg,
        depth_uncertainty=comparison.depth_uncertainty,
        best_model=comparison.best,
        models=comparison.rungs,
        leave_one_out=None
        if jackknife is None
        else LeftOut(
            images=tuple(names[k] for k in jackknife.images),
            change_deg=tuple(jackknife.change_deg.tolist()),
            jackknife_deg=jackknife.jackknife_deg,
        ),
        scan_drift=ScanDriftFigures(largest_px=drift, best=comparison.best == DRIFT_RUNG),
    )
    return figures, reliability_notes(figures, comparison, tilt_known=tilt_known)


def largest_drift_px(comparison: ModelComparison) -> float:
    """The largest displacement of a last row against the first, under the rung with drift."""
    return 0.0 if comparison.drift_px is None else float(np.max(np.abs(comparison.drift_px)))


def reliability_notes(
    figures: Reliability, comparison: ModelComparison, *, tilt_known: bool
) -> list[str]:
    """Sentences on what the figures leave in doubt."""
    notes = []
    if figures.total_rotation_deg < SMALL_ROTATION_DEG:
        notes.append(
            f"the total rotation is only {figures.total_rotation_deg:.2f} deg (sigma "
            f"{figures.total_rotation_sigma_deg:.2f}): angles and depths are weakly determined; "
            "tilt further" + ("" if tilt_known else ", or give the known tilt")
        )
    if comparison.depth_uncertainty > MIN_UNCERTAINTY and comparison.disagree:
        notes.append(comparison.message)
    if comparison.best == DRIFT_RUNG:
        notes.append(
            "rows within the frames are displaced, the last against the first by up to "
            f"{largest_drift_px(comparison):.2f} px: stage creep or charging while a frame was "
            "scanned; a camera model with that drift explains the images best, the cameras written "
            "do not have it; scan faster, or wait longer after each tilt"
        )
    return notes


def total_rotation_sigma(refined: Refined, covariance: Covariance) -> float:
    """Standard deviation of the angle between the two images furthest apart, in rad.

    With ``R_ab = R_a R_b^T`` about the axis n a step (w_a, w_b) changes the angle by
    ``n . (w_a - w_b)``.
    """
    R = np.asarray(refined.cameras.cam_from_world)
    a, b = widest_pair(R)
    n = vector_from_rotation(R[b] @ R[a].T)
    n = np.asarray(n / max(float(np.linalg.norm(n)), 1e-300))
    idx = refined.adjustment.model.param_idx
    g = np.zeros(len(covariance.cameras.gauge))
    g[idx[b, :3]] += n
    g[idx[a, :3]] -= n
    return float(np.sqrt(covariance.cameras.variance(g)))
