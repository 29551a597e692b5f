"""Scan drift and shading estimated together, and observations as they would be without either."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from semsfm_colmap.geometry.perspective import Perspective
from semsfm_colmap.geometry.scan_drift import without_drift
from semsfm_colmap.records import DragFigures, PerspectiveFigures
from semsfm_colmap.refinement.adjustment import BundleSettings, PoseModel
from semsfm_colmap.refinement.bundle import adjust, plain_model
from semsfm_colmap.refinement.covariance import camera_covariance
from semsfm_colmap.refinement.drag import (
    DragModel,
    doubt_px,
    drag_field,
    misfit_px,
    seen_normals,
)
from semsfm_colmap.refinement.model_choice import total_rotation
from semsfm_colmap.refinement.perspective import PerspectiveModel
from semsfm_colmap.refinement.refine import Refined
from semsfm_colmap.refinement.scan_drift import ScanDriftModel
from semsfm_colmap.refinement.shading import (
    NUM_FIELDS,
    ShadingModel,
    reversed_coefficients,
    shading_fields,
)
from semsfm_colmap.refinement.shared_scalar import SharedScalarModel
from semsfm_colmap.refinement.uncertainty import clustered_modes, shared_mode, surface_patches
from semsfm_colmap.types import Float, Observations


@dataclass(frozen=True, kw_only=True, eq=False)
class Displacement:
    """What displaces the observations of a part beside the cameras."""

    drift_px: Float
    """(M, 2) from the first row of each frame to the last; zero where none was sought"""
    drift_sigma_px: float
    """Prior; 0 where none was sought"""
    drag_px: float = 0.0
    """Coefficient of the drag"""
    drag_prior_px: float = 0.0
    """Its prior; 0 where none was sought"""
    drag_sigma_px: float = 0.0
    """Its standard deviation in full"""
    drag_doubt_px: float = 0.0
    """The part of it that neither noise nor what patches err in together explains"""
    drag_formal_px: float = 0.0
    """Its standard deviation if all observations erred independently"""
    shading_px: Float | None = None
    """(9,) coefficients of the other fields of shading; None where they were not sought"""
    perspective: PerspectiveFigures | None = None
    """None where none was found, or not so much that it was taken out"""
    view: Perspective | None = None
    """what was taken out, in the world of the cameras"""

    def drag_figures(self, *, reverse: bool) -> DragFigures | None:
        """The coefficient with its standard deviations; None where it was not sought.

        Of the depth-reversed model the outward normals point the other way in the image.
        """
        if self.drag_prior_px <= 0.0:
            return None
        shading = self.shading_px
        if reverse and shading is not None:
            shading = reversed_coefficients(shading)
        return DragFigures(
            coefficient_px=-self.drag_px if reverse else self.drag_px,
            sigma_px=self.drag_sigma_px,
            formal_sigma_px=self.drag_formal_px,
            shading_px=None if shading is None else tuple(shading.tolist()),
        )

    def perspective_figures(self, *, reverse: bool) -> PerspectiveFigures | None:
        """What was found, its sign that of the hand."""
        found = self.perspective
        if found is None or not reverse:
            return found
        return replace(
            found,
            kappa_per_px=-found.kappa_per_px,
            distance_px=-found.distance_px,
            distance_radii=-found.distance_radii,
        )

    @classmethod
    def none(cls, num_images: int) -> Displacement:
        """Nothing is displaced."""
        return cls(drift_px=np.zeros((num_images, 2)), drift_sigma_px=0.0)


def displacing_model(
    base: PoseModel[Any],
    height_px: Float,
    refined: Refined,
    *,
    drift_sigma_px: float,
    drag_sigma_px: float,
    shading: bool = False,
    principal_px: Float | None = None,
) -> PoseModel[Any]:
    """Drift and drag around a model, each where its prior is above 0; perspective about a point.

    Parameters
    ----------
    shading : with the drag the other fields of shading

    """
    model: PoseModel[Any] = base
    if drift_sigma_px > 0.0:
        model = ScanDriftModel.build(base, drift_sigma_px, height_px)
    if principal_px is not None:
        model = PerspectiveModel.build(model, refined.cameras, refined.points, principal_px)
    if drag_sigma_px > 0.0:
        normals = seen_normals(refined.points, refined.cameras, refined.observations)
        R = np.asarray(refined.cameras.cam_from_world)
        if shading:
            model = ShadingModel(base=model, cam_from_world=R, normals=normals)
        model = DragModel(base=model, cam_from_world=R, normals=normals, sigma=drag_sigma_px)
    return model


def undisplaced_params(model: PoseModel[Any], cameras: Any) -> Any:
    """The parameters of a model with these cameras, no drift, no shading, no perspective."""
    if isinstance(model, SharedScalarModel):
        return undisplaced_params(model.base, cameras), 0.0
    if isinstance(model, ShadingModel):
        return undisplaced_params(model.base, cameras), np.zeros(NUM_FIELDS)
    if isinstance(model, ScanDriftModel):
        return cameras, np.zeros((len(model.height_px), 2))
    return cameras


def find_displacement(refined: Refined, height_px: Float, settings: BundleSettings) -> Displacement:
    """Drift and drag of a part, estimated with its cameras and points.

    Of several series the other fields of shading are estimated as well, see `shading`.

    What shading does is not independent noise, so the coefficient of the drag is known far less
    well than its formal error says. Its least squares value is therefore weighed against the prior
    with its full variance V: ``c <- c sigma^2 / (sigma^2 + V)``, and drift and fields follow.

    Parameters
    ----------
    height_px : (M,) heights of the images registered
    settings : a prior of 0: not sought

    """
    M = len(refined.cameras)
    drift_sigma_px, drag_sigma_px = settings.drift_sigma_px, settings.drag_sigma_px
    if drift_sigma_px <= 0.0 and drag_sigma_px <= 0.0:
        return Displacement.none(M)
    base = plain_model(M, settings.scale_sigma)
    model = displacing_model(
        base,
        height_px,
        refined,
        drift_sigma_px=drift_sigma_px,
        drag_sigma_px=drag_sigma_px,
        shading=refined.cameras.num_series > 1,
    )
    start = undisplaced_params(model, refined.cameras)
    adjusted = adjust(model, start, refined.observations, settings).value
    assert adjusted is not None
    end = adjusted.state
    inner = end.params[0] if isinstance(model, DragModel) else end.params
    shading = None
    if isinstance(model, DragModel) and isinstance(model.base, ShadingModel):
        inner, shading = inner
    drift = inner[1] if drift_sigma_px > 0.0 else np.zeros((M, 2))
    found = Displacement(drift_px=drift, drift_sigma_px=drift_sigma_px)
    if not isinstance(model, DragModel):
        return found
    cameras = camera_covariance(model, end, refined.observations, refined.sigma_px)
    if cameras is None:
        return found
    patch = surface_patches(refined.points)
    clustered = clustered_modes(model, end, refined.observations, refined.sigma_px, cameras, patch)
    follow, formal = shared_mode(cameras, model.num_params - 1)
    rotation = total_rotation(np.asarray(refined.cameras.cam_from_world))
    misfit = misfit_px(float(np.rad2deg(rotation)))
    variance = formal**2 + float(clustered[-1] @ clustered[-1]) + misfit**2
    trust = drag_sigma_px**2 / (drag_sigma_px**2 + variance)
    drag = trust * float(end.params[1])
    moved = (drag - end.params[1]) * follow
    if drift_sigma_px > 0.0:
        drift = drift + moved[base.num_params : base.num_params + 2 * M].reshape(M, 2)
    if shading is not None:
        shading = shading + moved[-1 - NUM_FIELDS : -1]
    return replace(
        found,
        drift_px=drift,
        drag_px=drag,
        drag_prior_px=drag_sigma_px,
        drag_sigma_px=float(np.sqrt(trust * variance + doubt_px(drag) ** 2)),
        drag_doubt_px=float(np.sqrt(trust * misfit**2 + doubt_px(drag) ** 2)),
        drag_formal_px=formal,
        shading_px=shading,
    )


def without_displacement(
    observations: Observations,
    displacement: Displacement,
    refined: Refined,
    height_px: Float,
) -> Observations:
    """The observations (of the whole series) as they would be in frames scanned at once.

    Tracks that have no point, hence no normal, keep what shading does.

    Parameters
    ----------
    height_px : heights of all images of the series

    """
    obs = observations
    drift = np.zeros((obs.num_images, 2))
    drift[refined.images] = displacement.drift_px
    i = obs.image_idx
    xy = without_drift(obs.xy, drift[i], height_px[i])
    if displacement.drag_px != 0.0:
        R = np.zeros((obs.num_images, 3, 3))
        R[refined.images] = refined.cameras.cam_from_world
        normals = np.zeros((obs.num_tracks, 3))
        normals[refined.tracks] = seen_normals(
            refined.points, refined.cameras, refined.observations
        )
        xy = xy - displacement.drag_px * drag_field(R, normals, i, obs.track_idx)
        if displacement.shading_px is not None:
            xy = xy - shading_fields(R, normals, i, obs.track_idx) @ displacement.shading_px
    # as a COLMAP database will hold them
    return replace(obs, xy=xy.astype(np.float32).astype(np.float64))
