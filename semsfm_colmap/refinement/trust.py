"""How far to trust a model: error bars, the ladder of camera models, leave-one-image-out."""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import Any

import numpy as np

from semsfm_colmap.geometry.eliminated import Eliminated, SolverOptions
from semsfm_colmap.geometry.rotations import vector_from_rotation
from semsfm_colmap.motion.small_tilt import SMALL_ROTATION_DEG
from semsfm_colmap.refinement.covariance import Covariance, estimate_covariance
from semsfm_colmap.refinement.leave_one_out import leave_one_out
from semsfm_colmap.refinement.model_choice import (
    DRIFT_RUNG,
    MAX_TRACKS,
    compare_models,
    thin_tracks,
    total_rotation,
    widest_pair,
)
from semsfm_colmap.refinement.options import RefinementOptions
from semsfm_colmap.refinement.refine import Refined
from semsfm_colmap.refinement.scan_drift import ScanDriftModel
from semsfm_colmap.types import Float


def covariance_of(refined: Refined, height_px: Float, drift_sigma_px: float) -> Covariance | None:
    """Error bars of a refined model.

    Where scan drift was taken out of the observations it is not known any better than it was
    estimated: the error bars are those of the model that has it, at no drift.

    Parameters
    ----------
    height_px : (M,) heights of the images registered
    drift_sigma_px : prior of the drift; 0 where none was sought

    """
    if drift_sigma_px <= 0.0:
        return estimate_covariance(
            refined.model, refined.state, refined.observations, refined.sigma_px
        ).value
    model = ScanDriftModel.build(refined.model, drift_sigma_px, height_px)
    state: Eliminated[Any] = refined.state
    state = replace(state, params=(refined.state.params, np.zeros((len(height_px), 2))))
    return estimate_covariance(model, state, refined.observations, refined.sigma_px).value


def reliability(
    refined: Refined,
    covariance: Covariance | None,
    options: RefinementOptions,
    height_px: Float,
    *,
    tilt_known: bool,
) -> tuple[dict[str, Any], list[str]]:
    """Total rotation with its error bar, the ladder of models, leave-one-out; and what they say."""
    solver = SolverOptions(
        loss=options.last_loss,
        loss_width=options.loss_width,
        cost_tolerance=1e-7,
        absolute_tolerance=1e-2,
        max_iterations=options.max_iterations,
    )
    sigma_deg = 0.0
    range_deg = float(np.rad2deg(total_rotation(np.asarray(refined.cameras.cam_from_world))))
    if covariance is not None:
        sigma_deg = float(np.rad2deg(total_rotation_sigma(refined, covariance)))
    comparison = compare_models(
        refined.cameras,
        refined.observations,
        scale_sigma=options.scale_sigma,
        affine_sigma=options.affine_sigma,
        sigma_px=refined.sigma_px,
        range_sigma_rad=np.deg2rad(sigma_deg),
        height_px=height_px if options.drift_sigma_px > 0.0 else None,
        drift_sigma_px=options.drift_sigma_px,
        solver=solver,
    )
    jackknife = leave_one_out(
        refined.cameras,
        thin_tracks(refined.observations, MAX_TRACKS),
        camera_model=options.camera_model,
        scale_sigma=options.scale_sigma,
        affine_sigma=options.affine_sigma,
        sigma_px=refined.sigma_px,
        solver=solver,
    )
    notes = []
    if range_deg < SMALL_ROTATION_DEG:
        notes.append(
            f"the total rotation is only {range_deg:.2f} deg (sigma {sigma_deg:.2f}): angles and "
            "depths are weakly determined; tilt further"
            + ("" if tilt_known else ", or give the known tilt")
        )
    if comparison.depth_uncertainty > 0.01 and "disagree" in comparison.message:
        notes.append(comparison.message)
    drift = 0.0 if comparison.drift_px is None else float(np.max(np.abs(comparison.drift_px)))
    if comparison.best == DRIFT_RUNG:
        notes.append(
            "rows within the frames are displaced, the last against the first by up to "
            f"{drift:.2f} px: stage creep or charging while a frame was scanned; a camera model "
            "with that drift explains the images best, the cameras written do not have it; scan "
            "faster, or wait longer after each tilt"
        )
    figures: dict[str, Any] = {
        "total_rotation_deg": range_deg,
        "total_rotation_sigma_deg": sigma_deg,
        "models": [asdict(rung) for rung in comparison.rungs],
        "best_model": comparison.best,
        "depth_uncertainty": comparison.depth_uncertainty,
        "scan_drift": {"largest_px": drift, "best": comparison.best == DRIFT_RUNG},
    }
    if jackknife is not None:
        figures["leave_one_out"] = {
            "images": jackknife.images.tolist(),
            "change_deg": jackknife.change_deg.tolist(),
            "jackknife_deg": jackknife.jackknife_deg,
        }
    return figures, notes


def total_rotation_sigma(refined: Refined, covariance: Covariance) -> float:
    """Standard deviation of the angle between the two images furthest apart, in rad.

    With ``R_ab = R_a R_b^T`` about the axis n a step (w_a, w_b) changes the angle by
    ``n . (w_a - w_b)``.
    """
    R = np.asarray(refined.cameras.cam_from_world)
    a, b = widest_pair(R)
    n = vector_from_rotation(R[b] @ R[a].T)
    n = np.asarray(n / max(float(np.linalg.norm(n)), 1e-300))
    g = np.zeros(len(covariance.cameras.gauge))
    g[refined.model.param_idx[b, :3]] += n
    g[refined.model.param_idx[a, :3]] -= n
    return float(np.sqrt(covariance.cameras.variance(g)))
