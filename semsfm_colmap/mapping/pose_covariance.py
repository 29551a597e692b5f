"""The joint covariance of the rotations of a reconstruction, made again from its observations.

What is written of a model holds a standard deviation for each image, but angles do not err one by
one: what shading, drag or a wrong camera model does stretches all of them. The observations of the
model, with what was taken out of them, give the joint covariance again as mapping had it
(`refinement.trust.uncertainty_of`),

    cov(w_i, w_j) = C_ij + sum_m m_i m_j^T,

w_i the rotation vector of image i in its camera frame, C of the noise, m the modes. What the camera
models disagree on, and perspective that was left in, are known from the model's own record alone:
as a stretch of all angles (`angle_stretch`).
"""

from __future__ import annotations

import numpy as np

from semsfm_colmap.geometry.eliminated import Eliminated
from semsfm_colmap.geometry.points import track_pointer
from semsfm_colmap.geometry.subset import keep_tracks
from semsfm_colmap.records import Reliability
from semsfm_colmap.refinement.adjustment import Adjustment
from semsfm_colmap.refinement.bundle import plain_model
from semsfm_colmap.refinement.displaced import Displacement
from semsfm_colmap.refinement.drag import doubt_px, misfit_px
from semsfm_colmap.refinement.noise import noise_sigma
from semsfm_colmap.refinement.options import RefinementOptions
from semsfm_colmap.refinement.refine import Refined
from semsfm_colmap.refinement.trust import uncertainty_of
from semsfm_colmap.refinement.uncertainty import apply_covariance
from semsfm_colmap.types import Float, OrthographicCameras, Reconstruction

STRETCHING = ("models", "perspective")
"""Parts of the total rotation's standard deviation that the observations alone do not give."""


def rotation_covariance(
    reconstruction: Reconstruction,
    options: RefinementOptions,
    reliability: Reliability | None,
) -> Float | None:
    """Covariance (3M, 3M) of the rotation vectors of all images, rad^2; None: not determined.

    Its gauge is that of inner constraints; differences of angles do not depend on it.

    Parameters
    ----------
    options : what the model was mapped with
    reliability : what mapping said of the model, where that is known

    """
    refined = as_refined(reconstruction, options)
    height_px = reconstruction.image_size_px[:, 1].astype(np.float64)
    found = uncertainty_of(
        refined, height_px, displacement_of(reconstruction, options, reliability)
    )
    if found is None:
        return None
    rows = refined.adjustment.model.param_idx[:, :3].reshape(-1)
    unit = np.zeros((len(found.noise.cameras.gauge), len(rows)))
    unit[rows, np.arange(len(rows))] = 1.0
    covariance = apply_covariance(found.noise.cameras, unit)[rows]
    for modes in found.modes.values():
        covariance += modes[rows] @ modes[rows].T
    return np.asarray(0.5 * (covariance + covariance.T))


def angle_stretch(reliability: Reliability | None) -> float:
    """Relative standard deviation of all angles by what the observations do not tell again."""
    if reliability is None or reliability.total_rotation_deg <= 0.0:
        return 0.0
    parts = reliability.total_rotation_sigma_parts_deg or {}
    size = np.linalg.norm([parts.get(name, 0.0) for name in STRETCHING])
    return float(size) / reliability.total_rotation_deg


def displacement_of(
    reconstruction: Reconstruction, options: RefinementOptions, reliability: Reliability | None
) -> Displacement:
    """What was taken out of the observations, with how well it is known."""
    drift = reconstruction.drift_px
    found = Displacement.none(reconstruction.num_images)
    if drift is None and reconstruction.drag_px is None:
        return found
    drag, prior = reconstruction.drag_px, options.drag_sigma_px
    figures = None if reliability is None else reliability.drag
    doubt = doubt_px(drag or 0.0)
    if reliability is not None and figures is not None and prior > 0.0:
        # sigma^2 = trust V + doubt^2 with trust = prior^2 / (prior^2 + V), solved for trust
        trust = 1.0 - (figures.sigma_px**2 - doubt**2) / prior**2
        doubt = float(np.hypot(doubt, trust**0.5 * misfit_px(reliability.total_rotation_deg)))
    return Displacement(
        drift_px=found.drift_px if drift is None else np.asarray(drift),
        drift_sigma_px=0.0 if drift is None else options.drift_sigma_px,
        drag_px=drag or 0.0,
        drag_prior_px=0.0 if drag is None else prior,
        drag_doubt_px=doubt,
    )


def as_refined(reconstruction: Reconstruction, options: RefinementOptions) -> Refined:
    """The model as its adjustment left it: about a pixel a unit, with its points and residuals."""
    cameras = reconstruction.cameras
    px_per_unit = cameras.mean_scale_px_per_unit
    scaled = OrthographicCameras(
        cam_from_world=np.asarray(cameras.cam_from_world),
        scale_px_per_unit=cameras.scale_px_per_unit / px_per_unit,
        translation_px=np.asarray(cameras.translation_px),
        aspect=cameras.aspect,
        skew=cameras.skew,
    )
    used, tracks = keep_tracks(
        reconstruction.observations, np.asarray(reconstruction.inlier), min_length=2
    )
    points = np.asarray(reconstruction.points)[tracks] * px_per_unit
    residuals = scaled.project(points[used.track_idx], used.image_idx) - used.xy
    model = plain_model(len(scaled), options.scale_sigma)
    pointer = track_pointer(used.track_idx, used.num_tracks)
    state = Eliminated(
        params=scaled, X=points, residuals=residuals, weight=np.ones(len(used)), cost=0.0
    )
    return Refined(
        images=np.arange(len(scaled)),
        cameras=scaled,
        tracks=np.asarray(tracks),
        points=points,
        inlier=np.asarray(reconstruction.inlier),
        sigma_px=noise_sigma(residuals, used.precision, pointer, len(scaled)),
        rounds=(),
        observations=used,
        rms_px=float(np.sqrt(np.mean(residuals**2))),
        adjustment=Adjustment(model=model, state=state),
    )
