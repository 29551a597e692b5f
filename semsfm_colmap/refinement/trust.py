"""How far to trust a model: error bars, the ladder of camera models, leave-one-image-out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from semsfm_colmap.geometry.eliminated import Eliminated
from semsfm_colmap.geometry.rotations import vector_from_rotation
from semsfm_colmap.motion.small_tilt import SMALL_ROTATION_DEG
from semsfm_colmap.records import LeftOut, Reliability, Rung, ScanDriftFigures
from semsfm_colmap.refinement.adjustment import BundleSettings, PoseModel, comparing_solver
from semsfm_colmap.refinement.covariance import Covariance, estimate_covariance
from semsfm_colmap.refinement.displaced import (
    Displacement,
    displacing_model,
    undisplaced_params,
)
from semsfm_colmap.refinement.drag import (
    DRAG_SIGMA_PX,
    DragModel,
    drag_field,
    seen_normals,
)
from semsfm_colmap.refinement.half_series import half_series
from semsfm_colmap.refinement.leave_one_out import leave_one_out
from semsfm_colmap.refinement.model_choice import (
    MAX_TRACKS,
    ModelComparison,
    compare_models,
    judge,
    thin_tracks,
    total_rotation,
    widest_pair,
)
from semsfm_colmap.refinement.model_spread import model_mode
from semsfm_colmap.refinement.options import RefinementOptions
from semsfm_colmap.refinement.perspective import PerspectiveFit, PerspectiveModel
from semsfm_colmap.refinement.refine import Refined
from semsfm_colmap.refinement.repeated_views import counted_once, repeated_notes
from semsfm_colmap.refinement.shading import (
    SERIES_SIGMA_PX,
    SHADING_SIGMA_PX,
    fields_of_series,
    shading_fields,
)
from semsfm_colmap.refinement.uncertainty import (
    Uncertainty,
    clustered_modes,
    field_modes,
    relief_sigma,
    shared_mode,
    surface_patches,
    with_modes,
    with_relief,
)
from semsfm_colmap.types import Float

PERSPECTIVE_SHARE = 0.5
"""Standard deviation of what perspective does that was not taken out, as a share of it."""
MIN_UNCERTAINTY = 0.01
"""A spread of the camera models below one percent is not worth a sentence."""


def covariance_of(
    refined: Refined, height_px: Float, displacement: Displacement
) -> Covariance | None:
    """Formal error bars of a refined model: what independent noise does.

    What was taken out of the observations is not known any better than it was estimated: the error
    bars are those of the model that has it, at no drift and no drag.

    Parameters
    ----------
    height_px : (M,) heights of the images registered

    """
    model, state = displaced_state(refined, height_px, displacement)
    counted = counted_once(refined)
    return estimate_covariance(model, state, counted.observations, counted.sigma_px).value


def compare(
    refined: Refined,
    options: RefinementOptions,
    height_px: Float,
    size_px: Float | None = None,
    further: tuple[Rung, ...] = (),
) -> ModelComparison:
    """The ladder of camera models on the observations of a refined model.

    Parameters
    ----------
    height_px, size_px : (M,) heights, (M, 2) widths and heights of the images registered
    further : rungs that were fitted elsewhere

    """
    return compare_models(
        refined.cameras,
        refined.observations,
        BundleSettings.of(options, refined.sigma_px, comparing_solver(options)),
        height_px=height_px if options.drift_sigma_px > 0.0 else None,
        size_px=size_px,
        further=further,
    )


def uncertainty_of(
    refined: Refined,
    height_px: Float,
    displacement: Displacement,
    *,
    left_in: PerspectiveFit | None = None,
    comparison: ModelComparison | None = None,
    camera_model: str = "scaled_orthographic",
) -> Uncertainty | None:
    """Error bars of a refined model in full, in parts; None where something is not determined.

    Parameters
    ----------
    left_in : perspective that was found but not taken out of the observations
    comparison : the ladder of camera models, whose disagreement is one of the parts
    camera_model : the one that is written

    """
    model, state = displaced_state(refined, height_px, displacement)
    counted = counted_once(refined)
    obs, sigma_px = counted.observations, counted.sigma_px
    noise = estimate_covariance(model, state, obs, sigma_px).value
    if noise is None:
        return None
    cameras = noise.cameras
    patch = surface_patches(refined.points)
    modes = {"clustered": clustered_modes(model, state, obs, sigma_px, cameras, patch)}
    R = np.asarray(refined.cameras.cam_from_world)
    if isinstance(model, DragModel):
        follow, _ = shared_mode(cameras, model.num_params - 1)
        modes["drag"] = displacement.drag_doubt_px * follow[:, None]
        normals = model.normals
    else:
        # nothing was taken out: it is all there
        normals = seen_normals(refined.points, refined.cameras, obs)
        field = drag_field(R, normals, obs.image_idx, obs.track_idx)[:, :, None]
        modes["drag"] = DRAG_SIGMA_PX * field_modes(model, state, obs, sigma_px, cameras, field)
    of = (R, normals, obs.image_idx, obs.track_idx)
    fields = SHADING_SIGMA_PX * shading_fields(*of)
    if refined.cameras.series_idx is not None and refined.cameras.num_series > 1:
        fields = SERIES_SIGMA_PX * fields_of_series(*of, refined.cameras.series_idx)
    modes["shading"] = field_modes(model, state, obs, sigma_px, cameras, fields)
    if left_in is not None:
        view = PerspectiveModel.build(
            model, refined.cameras, refined.points, left_in.model.principal_px
        )
        field = view.field(0.0, obs.image_idx, obs.track_idx)[:, :, None]
        effect = left_in.kappa * field_modes(model, state, obs, sigma_px, cameras, field)
        modes["perspective"] = PERSPECTIVE_SHARE * effect
    if comparison is not None:
        apart = model_mode(comparison, camera_model, model.param_idx, model.num_params)
        if apart is not None:
            modes["models"] = apart
    found = Uncertainty(noise=noise, total=noise, notes=tuple(repeated_notes(counted)))
    found = with_modes(found, modes, model, state, obs, sigma_px)
    found = with_principal_point(found, displacement)
    return with_relief(found, normals, relief_sigma(refined.points))


def with_principal_point(uncertainty: Uncertainty, displacement: Displacement) -> Uncertainty:
    """The cameras' error bars with that of the place which perspective is about.

    A shift of it turns all cameras alike, by kappa times the shift, about the image's axes: no
    angle between them changes, nor does a point.
    """
    found = displacement.perspective
    if found is None or found.principal_sigma_px is None:
        return uncertainty
    turn = found.kappa_per_px * found.principal_sigma_px
    variance = uncertainty.total.sigma_rotation_rad**2 + turn**2 * np.array([1.0, 1.0, 0.0])
    total = replace(uncertainty.total, sigma_rotation_rad=np.sqrt(variance))
    return replace(uncertainty, total=total)


def displaced_state(
    refined: Refined, height_px: Float, displacement: Displacement
) -> tuple[PoseModel[Any], Eliminated[Any]]:
    """The model that has what was taken out of the observations, at nothing left of it."""
    model = displacing_model(
        refined.adjustment.model,
        height_px,
        refined,
        drift_sigma_px=displacement.drift_sigma_px,
        drag_sigma_px=displacement.drag_prior_px,
        shading=displacement.shading_px is not None,
        principal_px=None if displacement.view is None else displacement.view.principal_px,
    )
    state: Eliminated[Any] = refined.adjustment.state
    return model, replace(state, params=undisplaced_params(model, refined.adjustment.state.params))


def reliability(
    refined: Refined,
    uncertainty: Uncertainty | None,
    options: RefinementOptions,
    comparison: ModelComparison,
    names: Sequence[str],
    *,
    tilt_known: bool,
    drift_found: bool = False,
) -> tuple[Reliability, list[str]]:
    """Total rotation with its error bar, the ladder of models, leave-one-out; and what they say.

    Parameters
    ----------
    comparison : the ladder, as `uncertainty` has it
    names : of the images registered
    drift_found : a drift in the observations as they are is a finding

    """
    settings = BundleSettings.of(options, refined.sigma_px, comparing_solver(options))
    sigma_deg, parts_deg = 0.0, None
    range_deg = float(np.rad2deg(total_rotation(np.asarray(refined.cameras.cam_from_world))))
    if uncertainty is not None:
        sigma_deg = float(np.rad2deg(total_rotation_sigma(refined, uncertainty)))
        parts = total_rotation_parts(refined, uncertainty)
        parts_deg = {name: float(np.rad2deg(part)) for name, part in parts.items()}
    # what the models disagree on is no excuse for their disagreement
    others = [part for name, part in (parts_deg or {}).items() if name != "models"]
    verdict = judge(comparison.rungs, float(np.linalg.norm(others)) if others else 0.0)
    comparison = replace(comparison, disagree=verdict.disagree, message=verdict.message)
    jackknife = leave_one_out(
        refined.cameras, thin_tracks(refined.observations, MAX_TRACKS), settings
    )
    halves = half_series(
        refined.cameras, thin_tracks(refined.observations, 2 * MAX_TRACKS), settings
    )
    drift = largest_drift_px(comparison)
    figures = Reliability(
        total_rotation_deg=range_deg,
        total_rotation_sigma_deg=sigma_deg,
        total_rotation_sigma_parts_deg=parts_deg,
        relief_px=None if uncertainty is None else uncertainty.relief_px,
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
        half_series=halves,
        scan_drift=ScanDriftFigures(largest_px=drift, best=drift_found),
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
    if figures.scan_drift is not None and figures.scan_drift.best:
        notes.append(
            "rows within the frames are displaced, the last against the first by up to "
            f"{largest_drift_px(comparison):.2f} px: stage creep or charging while a frame was "
            "scanned; a camera model with that drift explains the images best, the cameras written "
            "do not have it; scan faster, or wait longer after each tilt"
        )
    return notes


def total_rotation_direction(refined: Refined, num_params: int) -> Float:
    """Derivative (n,) of the angle between the two images furthest apart.

    With ``R_ab = R_a R_b^T`` about the axis n a step (w_a, w_b) changes the angle by
    ``n . (w_a - w_b)``.
    """
    R = np.asarray(refined.cameras.cam_from_world)
    a, b = widest_pair(R)
    n = vector_from_rotation(R[b] @ R[a].T)
    n = np.asarray(n / max(float(np.linalg.norm(n)), 1e-300))
    g = np.zeros(num_params)
    idx = refined.adjustment.model.param_idx
    g[idx[b, :3]] += n
    g[idx[a, :3]] -= n
    return g


def noise_of_total_rotation(refined: Refined, covariance: Covariance) -> float:
    """Formal standard deviation of the angle between the two images furthest apart, in rad."""
    g = total_rotation_direction(refined, len(covariance.cameras.gauge))
    return float(np.sqrt(covariance.cameras.variance(g)))


def total_rotation_parts(refined: Refined, uncertainty: Uncertainty) -> dict[str, float]:
    """Standard deviation of the angle between the two images furthest apart by cause, in rad."""
    g = total_rotation_direction(refined, len(uncertainty.noise.cameras.gauge))
    return uncertainty.parts(g)


def total_rotation_sigma(refined: Refined, uncertainty: Uncertainty) -> float:
    """Standard deviation of the angle between the two images furthest apart in full, in rad."""
    parts = total_rotation_parts(refined, uncertainty)
    return float(np.sqrt(sum(part**2 for part in parts.values())))
