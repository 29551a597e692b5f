"""The joint covariance of any places of a model: what its cameras do to a measured value.

A place seen in images i is where its rays meet best. With the camera parameters m and
``H = sum_i w_i A_i^T A_i`` it follows them by

    dX = G dm,    G = -H^-1 sum_i w_i A_i^T J_i,

J_i the derivative of its image in image i by the parameters, what was taken out of the observations
(scan drift, drag) among them. All places follow the same parameters, so that
``cov(X_a, X_b) = G_a C G_b^T + sum_m (G_a m)(G_b m)^T`` with C the formal covariance and m the
modes of `refinement.uncertainty`. A value f of many places, ``df = sum_k g_k . dX_k``, needs none
of these blocks: with the one direction ``d = sum_k G_k^T g_k`` of the camera parameters

    var f = d^T C d + sum_m (d . m)^2.

A world that is turned or shifted changes no value that is measured, and ``d`` is orthogonal to the
gauge by itself; scale is no part of it, the magnifications are held at their mean.

What the camera models disagree on, and perspective that was left in, is known from the model's own
record alone, as a stretch of all angles. Its mode turns image i by the share of its own rotation
away from the middle image, ``w_i = stretch log(R_i R_0^T)``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from semsfm_colmap.geometry.rotations import rotation_angle, vector_from_rotation
from semsfm_colmap.mapping.pose_covariance import (
    STRETCHING,
    angle_stretch,
    as_refined,
    displacement_of,
)
from semsfm_colmap.records import Reliability
from semsfm_colmap.refinement.adjustment import PoseModel
from semsfm_colmap.refinement.drag import DragModel
from semsfm_colmap.refinement.options import RefinementOptions
from semsfm_colmap.refinement.trust import displaced_state, uncertainty_of
from semsfm_colmap.refinement.uncertainty import Uncertainty, apply_covariance
from semsfm_colmap.types import Float, Int, Reconstruction

BATCH_OBSERVATIONS = 200_000
"""Observations whose derivatives are held at a time: some 30 MB."""
RAY_SHARE = 1e-9
"""Rays whose information in the worst direction is a smaller share of that in the best one meet
nowhere."""


@dataclass(frozen=True, kw_only=True, eq=False)
class JointCovariance:
    """The covariance of the camera parameters, and how places follow these."""

    model: PoseModel[Any]
    params: Any
    uncertainty: Uncertainty
    px_per_unit: float
    noise_px: float
    """Standard deviation of a coordinate of an observation"""

    def parts(self, direction: Float) -> dict[str, float]:
        """Standard deviation of a value by cause, from its direction (n,)."""
        return self.uncertainty.parts(direction)

    def surface_direction(
        self, points: Float, normals: Float, weights: Float, gradient: Float
    ) -> Float:
        """The module's d (n,) for places that follow all images that see them.

        Parameters
        ----------
        points, normals : (K, 3) world, outward
        weights : (K, M) of the images that see each, 0 where one does not
        gradient : (K, 3) of the value by the places, per world unit

        """
        A = self.projection
        H = np.einsum("km,mxi,mxj->kij", weights, A, A)
        information = np.linalg.eigvalsh(H)
        if np.any(information[:, 0] <= RAY_SHARE * information[:, 2]):
            raise ValueError("a place must be seen in two directions or more")
        y = np.linalg.solve(H, gradient[:, :, None])[:, :, 0] / self.px_per_unit
        out = np.zeros(self.num_params + 1)  # the last one collects index -1
        most = max(1, BATCH_OBSERVATIONS // max(weights.shape[1], 1))
        for some in range(0, len(points), most):
            batch = slice(some, some + most)
            track, image = np.nonzero(weights[batch])
            J = self._jacobian(points[batch], normals[batch], image, track)
            along = np.einsum("oxi,oi->ox", A[image], y[batch][track])
            pull = np.einsum("oxp,ox->op", J, weights[batch][track, image][:, None] * along)
            np.add.at(out, self.model.param_idx[image], -pull)
        return out[:-1]

    def ray_direction(self, points: Float, normals: Float, image: Int, gradient: Float) -> Float:
        """The module's d (n,) for places on the rays of pixels, each of one image (K,).

        Moving along its ray a place has no say in it: `gradient` is at right angles to the rays.
        """
        A = self.projection[image]
        J = self._jacobian(points, normals, image, np.arange(len(points)))
        back = np.linalg.solve(A @ A.transpose(0, 2, 1), A @ gradient[:, :, None])[:, :, 0]
        out = np.zeros(self.num_params + 1)
        pull = np.einsum("oxp,ox->op", J, back) / self.px_per_unit
        np.add.at(out, self.model.param_idx[image], -pull)
        return out[:-1]

    @property
    def num_params(self) -> int:
        """n, the camera parameters."""
        return self.model.num_params

    @property
    def projection(self) -> Float:
        """(M, 2, 3) px per px."""
        return np.asarray(self.model.poses(self.params).projection)

    @property
    def param_idx(self) -> Int:
        """(M, p) of each image's parameters, -1 for none."""
        return np.asarray(self.model.param_idx)

    def times(self, directions: Float) -> Float:
        """The covariance of the parameters, modes included, times directions (n, P)."""
        out = apply_covariance(self.uncertainty.noise.cameras, directions)
        for modes in self.uncertainty.modes.values():
            out = out + modes @ (modes.T @ directions)
        return out

    def image_derivatives(self, points: Float, normals: Float, image: int) -> Float:
        """(K, 2, p) px, of the places' pixels in an image by its parameters."""
        numbers = np.arange(len(points))
        return self._jacobian(points, normals, np.full(len(points), image), numbers)

    def _jacobian(self, points: Float, normals: Float, image_idx: Int, track_idx: Int) -> Float:
        model = self.model
        if isinstance(model, DragModel):
            model = replace(model, normals=np.ascontiguousarray(normals))
        return model.jacobian(self.params, points * self.px_per_unit, image_idx, track_idx)


def joint_covariance(
    reconstruction: Reconstruction, options: RefinementOptions, reliability: Reliability | None
) -> JointCovariance | None:
    """Make the covariance of a written model again; None where something is not determined.

    Parameters
    ----------
    options : what the model was mapped with
    reliability : what mapping said of the model, where that is known

    """
    refined = as_refined(reconstruction, options)
    height_px = reconstruction.image_size_px[:, 1].astype(np.float64)
    displacement = displacement_of(reconstruction, options, reliability)
    found = uncertainty_of(refined, height_px, displacement)
    if found is None:
        return None
    model, state = displaced_state(refined, height_px, displacement)
    R = np.asarray(reconstruction.cameras.cam_from_world)
    mode = _stretch_mode(R, angle_stretch(reliability), model)
    return JointCovariance(
        model=model,
        params=state.params,
        uncertainty=replace(found, modes={**found.modes, " and ".join(STRETCHING): mode}),
        px_per_unit=reconstruction.cameras.mean_scale_px_per_unit,
        noise_px=refined.sigma_px,
    )


def _stretch_mode(R: Float, stretch: float, model: PoseModel[Any]) -> Float:
    """The mode (n, 1) that stretches all angles about those of the image in the middle."""
    spread = [float(np.sum(rotation_angle(R @ R[i].T) ** 2)) for i in range(len(R))]
    middle = int(np.argmin(spread))
    mode = np.zeros((model.num_params, 1))
    rows = model.param_idx[:, :3]
    mode[rows, 0] = stretch * vector_from_rotation(R @ R[middle].T)
    return mode
