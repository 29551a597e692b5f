"""Orthographic bundle adjustment on rotations, points eliminated [paper: Levenberg-Marquardt].

    xy = s_i K2 (R_i X_j)[:2] + t_i,   K2 = [[1, skew], [0, aspect]]

Local parameters of an image: a rotation vector w on the left, ``R <- exp([w]x) R``, the logarithm
of its magnification, its translation, and (shared by all images) aspect and skew. With
``y = R X``: ``dy/dw = -[y]x``. The ladder of camera models is a matter of which parameters are
free. Gauge: none is fixed, the damping picks the smallest step; the magnification prior
``log s_i ~ N(0, scale_sigma)`` holds the common magnification at 1 px per unit.

Of several series in one model each has a magnification of its own, g_k px per unit, about which no
prior says anything: ``log s_i ~ N(log g_k(i), scale_sigma)`` and ``mean_i log s_i ~ N(0, .)``. At
the best g_k the residuals are ``r = (I - P_k + P_1) log s / scale_sigma``, P_k the means of the
series and P_1 the mean of all; as that matrix is a projection the gradient is r / scale_sigma,
that of the prior of one series, whose diagonal normal matrix, an upper bound, serves here too:
steps are a little short where the prior knows more of a magnification than the images do.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from scipy import sparse

from semsfm_colmap.geometry.eliminated import minimise
from semsfm_colmap.geometry.rotations import rotation_from_vector
from semsfm_colmap.geometry.threads import threads_for
from semsfm_colmap.refinement.adjustment import Adjustment, BundleSettings, PoseModel
from semsfm_colmap.refinement.bundle_kernels import fill_jacobian
from semsfm_colmap.refinement.known_angles import AnglePrior
from semsfm_colmap.types import Float, Int, Observations, OrthographicCameras, Solution

P = TypeVar("P")


@dataclass(frozen=True, kw_only=True, eq=False)
class BundleModel:
    """`CameraModel` of the orthographic ladder on `OrthographicCameras`."""

    param_idx: Int
    num_params: int
    scale_sigma: float
    affine_sigma: float
    angles: AnglePrior | None = None

    @classmethod
    def build(
        cls,
        num_images: int,
        *,
        free_scale: bool,
        free_affine: bool,
        scale_sigma: float,
        affine_sigma: float,
        angles: AnglePrior | None = None,
    ) -> BundleModel:
        """Number the free parameters; the magnifications are held fixed without `free_scale`."""
        per_image = [0, 1, 2, *([3] if free_scale else []), 4, 5]
        width = 8 if free_affine else 6
        idx = np.full((num_images, width), -1, dtype=np.int64)
        numbers = np.arange(num_images * len(per_image)).reshape(num_images, -1)
        idx[:, per_image] = numbers
        count = numbers.size
        if free_affine:
            idx[:, 6], idx[:, 7] = count, count + 1
            count += 2
        return cls(
            param_idx=idx,
            num_params=count,
            scale_sigma=scale_sigma,
            affine_sigma=affine_sigma,
            angles=angles,
        )

    def poses(self, params: OrthographicCameras) -> OrthographicCameras:
        """The parameters are the cameras."""
        return params

    def cameras(self, params: OrthographicCameras) -> tuple[Float, Float]:
        """The affine form of the cameras."""
        return params.projection, np.asarray(params.translation_px)

    def jacobian(
        self, params: OrthographicCameras, X: Float, image_idx: Int, track_idx: Int
    ) -> Float:
        """(O, 2, 6 or 8), see the module's formula."""
        J = np.zeros((len(image_idx), 2, self.param_idx.shape[1]))
        with threads_for(len(image_idx)):
            fill_jacobian(
                np.ascontiguousarray(params.cam_from_world),
                np.ascontiguousarray(params.scale_px_per_unit),
                params.aspect,
                params.skew,
                X,
                image_idx,
                track_idx,
                J,
            )
        return J

    def retract(self, params: OrthographicCameras, step: Float) -> OrthographicCameras:
        """Left-multiplied rotations, multiplied magnifications, added translations."""
        padded = np.concatenate([step, [0.0]])  # index -1 reads the zero
        local = padded[self.param_idx]
        shared = local[0, 6:8] if local.shape[1] == 8 else (0.0, 0.0)
        return replace(
            params,
            cam_from_world=rotation_from_vector(local[:, :3]) @ params.cam_from_world,
            scale_px_per_unit=params.scale_px_per_unit * np.exp(local[:, 3]),
            translation_px=params.translation_px + local[:, 4:6],
            aspect=float(params.aspect + shared[0]),
            skew=float(params.skew + shared[1]),
        )

    def prior(self, params: OrthographicCameras) -> tuple[Float, sparse.csr_array]:
        """Magnifications near 1; aspect near 1 and skew near 0; known angles."""
        values, rows, cols, derivs = [], [], [], []
        free_scale = self.param_idx[:, 3]
        if free_scale[0] >= 0:
            own = np.log(params.scale_px_per_unit / params.common_scale)
            values.append(own / self.scale_sigma)
            rows.append(np.arange(len(free_scale)))
            cols.append(free_scale)
            derivs.append(np.full(len(free_scale), 1.0 / self.scale_sigma))
        if self.param_idx.shape[1] == 8:
            values.append(np.array([params.aspect - 1.0, params.skew]) / self.affine_sigma)
            rows.append(sum(len(v) for v in values[:-1]) + np.arange(2))
            cols.append(self.param_idx[0, 6:8])
            derivs.append(np.full(2, 1.0 / self.affine_sigma))
        r, J = np.zeros(0), sparse.csr_array((0, self.num_params))
        if values:
            r = np.concatenate(values)
            J = sparse.csr_array(
                (np.concatenate(derivs), (np.concatenate(rows), np.concatenate(cols))),
                shape=(len(r), self.num_params),
            )
        if self.angles is not None:
            r_angle, J_angle = self.angles.residuals(
                params.cam_from_world, self.param_idx, self.num_params
            )
            r = np.concatenate([r, r_angle])
            J = sparse.csr_array(sparse.vstack([J, J_angle]))
        return r, J


def plain_model(num_images: int, scale_sigma: float) -> BundleModel:
    """Orthographic cameras with magnifications of their own."""
    return BundleModel.build(
        num_images, free_scale=True, free_affine=False, scale_sigma=scale_sigma, affine_sigma=1.0
    )


def bundle_adjust(
    cameras: OrthographicCameras,
    observations: Observations,
    settings: BundleSettings | None = None,
    *,
    angles: AnglePrior | None = None,
) -> Solution[Adjustment[OrthographicCameras]]:
    """Refine cameras and points to the minimum of the robust reprojection error.

    Parameters
    ----------
    cameras : magnifications near 1 px per unit (the prior's mean), or near those of their series
    observations : sorted by track, every track seen at least twice
    angles : known angles between images

    """
    settings = settings or BundleSettings()
    if settings.camera_model == "orthographic":
        cameras = replace(cameras, scale_px_per_unit=cameras.common_scale)
    model = BundleModel.build(
        len(cameras),
        free_scale=settings.camera_model != "orthographic",
        free_affine=settings.camera_model == "affine",
        scale_sigma=settings.scale_sigma,
        affine_sigma=settings.affine_sigma,
        angles=angles,
    )
    return adjust(model, cameras, observations, settings)


def adjust(
    model: PoseModel[P], params: P, observations: Observations, settings: BundleSettings
) -> Solution[Adjustment[P]]:
    """Search from `params` with any camera parametrisation."""
    end = minimise(model, params, observations, sigma_px=settings.sigma_px, options=settings.solver)
    return Solution(
        value=Adjustment(model=model, state=end),
        status="ok" if end.converged else "iteration_limit",
        message="" if end.converged else "bundle adjustment stopped before it converged",
        iterations=end.iterations,
        costs=end.costs,
    )
