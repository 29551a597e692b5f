"""Linear drift within a frame: a camera model for images scanned row by row.

While a frame is scanned the stage creeps or charge builds up, so a row is displaced in proportion
to the time at which it was read. An observation at row v is seen at

    xy = q + (a_i, b_i) (v_q - v_c) / H,    q = s_i K2 (R_i X)[:2] + t_i,

v_c the middle row and H the height of the image, (a_i, b_i) px over the height of the frame. That
is again an affine camera, ``A' = D_i A``, D_i = [[1, a_i / H], [0, 1 + b_i / H]]: to the data a
drift is an aspect and a skew of each frame's own. Half of the skew is a rotation about z, and a
tilt about x stretches y as b does; the other images' rays restrict but do not exclude either. What
tells drift from pose is the Gaussian prior ``a_i, b_i ~ N(0, sigma)``; without it the total
rotation of a small tilt series is free.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from semsfm_colmap.refinement.adjustment import Adjustment, BundleSettings, PoseModel
from semsfm_colmap.refinement.bundle import adjust, plain_model
from semsfm_colmap.types import Float, Int, Observations, OrthographicCameras, Solution

DriftParams = tuple[OrthographicCameras, Float]
"""Cameras and drift (M, 2), px over the height of the frame."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ScanDriftModel:
    """`CameraModel` of the orthographic ladder with a drift in each frame."""

    base: PoseModel[OrthographicCameras]
    sigma_px: float
    middle_row_px: Float
    """(M,)"""
    height_px: Float
    """(M,)"""

    @staticmethod
    def build(
        base: PoseModel[OrthographicCameras], sigma_px: float, height_px: Float
    ) -> ScanDriftModel:
        """Drift about the middle row of each image, its height (M,) px."""
        height = np.asarray(height_px, dtype=np.float64)
        return ScanDriftModel(
            base=base, sigma_px=sigma_px, middle_row_px=height / 2.0, height_px=height
        )

    @property
    def param_idx(self) -> Int:
        """The base's parameters, then a and b."""
        M = len(self.height_px)
        drift = self.base.num_params + np.arange(2 * M, dtype=np.int64).reshape(M, 2)
        return np.concatenate([self.base.param_idx, drift], axis=1)

    @property
    def num_params(self) -> int:
        """Two more an image than the base has."""
        return self.base.num_params + 2 * len(self.height_px)

    def poses(self, params: DriftParams) -> OrthographicCameras:
        """The cameras without their drift."""
        return params[0]

    def shear(self, drift: Float) -> Float:
        """D: (M, 2) -> (M, 2, 2)."""
        D = np.tile(np.eye(2), (len(drift), 1, 1))
        D[:, :, 1] += drift / self.height_px[:, None]
        return D

    def cameras(self, params: DriftParams) -> tuple[Float, Float]:
        """The affine cameras with the drift in them."""
        cameras, drift = params
        D = self.shear(drift)
        t = np.asarray(cameras.translation_px)
        from_middle = (t[:, 1] - self.middle_row_px) / self.height_px
        return D @ cameras.projection, t + drift * from_middle[:, None]

    def jacobian(self, params: DriftParams, X: Float, image_idx: Int, track_idx: Int) -> Float:
        """``D J`` of the base, and the row's place in the frame for a and b."""
        cameras, drift = params
        base = self.base.jacobian(cameras, X, image_idx, track_idx)
        J = np.zeros((len(image_idx), 2, base.shape[2] + 2))
        J[:, :, :-2] = self.shear(drift)[image_idx] @ base
        row = np.einsum("oj,oj->o", cameras.projection[image_idx, 1], X[track_idx])
        row = row + cameras.translation_px[image_idx, 1] - self.middle_row_px[image_idx]
        J[:, 0, -2] = J[:, 1, -1] = row / self.height_px[image_idx]
        return J

    def retract(self, params: DriftParams, step: Float) -> DriftParams:
        """The base's step; drifts are added."""
        cameras, drift = params
        n = self.base.num_params
        return self.base.retract(cameras, step[:n]), drift + step[n:].reshape(-1, 2)

    def prior(self, params: DriftParams) -> tuple[Float, sparse.csr_array]:
        """The base's, and drifts near zero."""
        cameras, drift = params
        r, J = self.base.prior(cameras)
        own = drift.ravel() / self.sigma_px
        eye = sparse.eye_array(len(own), format="csr") / self.sigma_px
        return np.concatenate([r, own]), sparse.csr_array(sparse.block_diag([J, eye]))


def adjust_with_drift(
    cameras: OrthographicCameras,
    observations: Observations,
    height_px: Float,
    settings: BundleSettings,
) -> Solution[Adjustment[DriftParams]]:
    """Scaled orthographic bundle adjustment with a drift in each frame.

    Parameters
    ----------
    cameras : magnifications near 1 px per unit
    observations : sorted by track
    height_px : (M,) heights of the images
    settings : its camera model does not count: magnifications are free, aspect and skew are not

    """
    M = len(cameras)
    base = plain_model(M, settings.scale_sigma)
    model = ScanDriftModel.build(base, settings.drift_sigma_px, height_px)
    return adjust(model, (cameras, np.zeros((M, 2))), observations, settings)
