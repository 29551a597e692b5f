"""Perspective around the parallel projection: one signed inverse distance for a series.

From a finite distance near things look larger. With q the parallel image of a point, z its depth
behind the middle c of the specimen as px of its image, and p where the optical axis meets the
image, the point is seen at

    xy = p + (q - p) / (1 + kappa z),    q = s K2 (R X)[:2] + t,    z = s (R (X - c))_z,

with one kappa in 1/px for all images: ``1 / kappa`` is the focal length of a pinhole camera that
sees just this, and its distance from the specimen, in px.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from semsfm_colmap.geometry.rotations import MIRROR_Z
from semsfm_colmap.types import Float, Int, OrthographicCameras

MAX_DEPTH_CHANGE = 0.5
"""kappa z stays below this, whatever a search tries."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Perspective:
    """The numbers of the module's formula that the cameras do not hold."""

    kappa: float
    """1/px; an ordinary lens has a positive one in the right hand"""
    centre: Float
    """(3,)"""
    principal_px: Float
    """(M, 2)"""

    def depth(self, cameras: OrthographicCameras, X: Float, image_idx: Int) -> Float:
        """Z of points X (O, 3), each in an image: (O,) px."""
        axis = np.asarray(cameras.scale_px_per_unit)[:, None] * cameras.viewing_direction
        return np.asarray(np.einsum("oi,oi->o", axis[image_idx], X - self.centre))

    def change(self, depth_px: Float) -> Float:
        """``kappa z``, within bounds."""
        return np.clip(self.kappa * depth_px, -MAX_DEPTH_CHANGE, MAX_DEPTH_CHANGE)

    def seen(self, q: Float, depth_px: Float, image_idx: Int) -> Float:
        """Where a point is seen that parallel projection shows at q (O, 2)."""
        p = self.principal_px[image_idx]
        return np.asarray(p + (q - p) / (1.0 + self.change(depth_px))[:, None])

    def parallel(self, xy: Float, depth_px: Float, image_idx: Int) -> Float:
        """The inverse of `seen`."""
        p = self.principal_px[image_idx]
        return np.asarray(p + (xy - p) * (1.0 + self.change(depth_px))[:, None])

    def slope(self, q: Float, depth_px: Float, image_idx: Int) -> Float:
        """Derivative of `seen` by kappa: (O, 2) px^2."""
        from_axis = q - self.principal_px[image_idx]
        return np.asarray(-from_axis * (depth_px / (1.0 + self.change(depth_px)) ** 2)[:, None])

    def local_affine(self, cameras: OrthographicCameras, X: Float, image_idx: Int) -> Float:
        """Derivative (O, 2, 3) of the place where each point is seen by the point."""
        z = self.depth(cameras, X, image_idx)
        axis = np.asarray(cameras.scale_px_per_unit)[:, None] * cameras.viewing_direction
        from_axis = self.seen(cameras.project(X, image_idx), z, image_idx)
        from_axis = from_axis - self.principal_px[image_idx]
        pull = self.kappa * np.einsum("oi,oj->oij", from_axis, axis[image_idx])
        return np.asarray(
            (cameras.projection[image_idx] - pull) / (1.0 + self.change(z))[:, None, None]
        )

    def reversed(self) -> Perspective:
        """What the depth-reversed cameras and points have."""
        return replace(self, kappa=-self.kappa, centre=MIRROR_Z @ self.centre)

    def pinhole_translations(self, cameras: OrthographicCameras) -> Float:
        """Translations (M, 3) of the pinholes of focal length 1 / kappa > 0 that see the same."""
        s = np.asarray(cameras.scale_px_per_unit)
        from_axis = np.asarray(cameras.translation_px) - self.principal_px
        across = from_axis @ np.linalg.inv(cameras.K2).T / s[:, None]
        along = 1.0 / (self.kappa * s) - cameras.viewing_direction @ self.centre
        return np.column_stack([across, along])
