"""Pinhole cameras in place of orthographic ones, at a focal length that the consumer can bear.

A consumer in double precision gets the focal length of the project's own sparse model. One in
float32 loses depth at large distances: with f = k max(W, H) the specimen is f px away, where
float32 numbers are 6e-8 f apart; a few of them add up to some 0.1 px at k = 1000. A short f in turn
shows perspective, ``|x - c| |z| / f`` px (`telecentric.py`). So k is taken from the wanted
deviation, kept between 300 and 1000, and the deviation that results is measured and stated.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from semsfm_colmap.colmap.model.telecentric import depths_px, required_focal_length
from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.exports.options import FormatOptions
from semsfm_colmap.types import Float, Int, Reconstruction

MIN_DISTANCE = 4.0
"""No camera nearer than so many times the largest depth: `telecentric.py` keeps to the same."""
MAX_SKEW_DEVIATION_PX = 0.5
"""A pinhole has no skew; a model whose skew moves an observation further is refused."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PinholeViews:
    """One pinhole an image: ``xy = focal * x_cam[:2] / x_cam[2] + principal_point``."""

    focal_px: Float
    """(M, 2) along x and y"""
    principal_point_px: Float
    """(M, 2)"""
    cam_from_world: Float
    """(M, 3, 3)"""
    translation: Float
    """(M, 3) world units"""
    focal_length_px: float
    """The nominal focal length: the focal length of an image of geometric mean magnification"""
    max_deviation_px: float
    """Largest distance to the orthographic cameras over the inlier observations"""

    def project(self, points: Float, image_idx: Int) -> Float:
        """Project ``points[o]`` into image ``image_idx[o]``: (O, 3), (O,) -> (O, 2) px."""
        x = np.einsum("oij,oj->oi", self.cam_from_world[image_idx], points)
        x = x + self.translation[image_idx]
        return np.asarray(
            self.focal_px[image_idx] * x[:, :2] / x[:, 2:] + self.principal_point_px[image_idx]
        )

    @property
    def centers(self) -> Float:
        """(M, 3) where the cameras stand in the world."""
        return np.asarray(-np.einsum("mji,mj->mi", self.cam_from_world, self.translation))


def choose_focal_length(
    reconstruction: Reconstruction, own_focal_px: float, options: FormatOptions, *, float32: bool
) -> float:
    """The focal length in px for a consumer in double precision or in float32.

    `own_focal_px` is that of the project's sparse model.
    """
    low, high = options.min_float32_focal_factor, options.max_float32_focal_factor
    if not 0 < low <= high or options.max_float32_deviation_px <= 0 or options.focal_factor < 0:
        raise UsageError(
            f"min_float32_focal_factor = {low:g}, max_float32_focal_factor = {high:g}, "
            f"max_float32_deviation_px = {options.max_float32_deviation_px:g}, focal_factor = "
            f"{options.focal_factor:g}: the first must be positive and no larger than the second, "
            "the third positive, the last 0 or positive"
        )
    size = float(np.max(reconstruction.image_size_px))
    if options.focal_factor > 0:
        return options.focal_factor * size
    if not float32 and options.max_deviation_px <= 0:
        return own_focal_px
    obs = reconstruction.observations.select(reconstruction.inlier)
    bound = options.max_float32_deviation_px if float32 else options.max_deviation_px
    focal = required_focal_length(
        reconstruction.cameras,
        reconstruction.points[obs.track_idx],
        obs.image_idx,
        reconstruction.image_size_px / 2.0,
        reconstruction.image_size_px,
        bound,
    )
    if float32:
        focal = float(np.clip(focal, low * size, high * size))
    return focal


def pinhole_views(
    reconstruction: Reconstruction, focal_length_px: float, *, equal_distance: bool = False
) -> PinholeViews:
    """Pinholes of a focal length, principal point at the image centre.

    Parameters
    ----------
    reconstruction : the orthographic cameras; their aspect goes into the focal length along y
    focal_length_px : nominal
    equal_distance : put each image's magnification into its focal length, so that all cameras are
        equally far from the origin, not into its distance. Depth ranges then hold for all images.

    """
    cameras = reconstruction.cameras
    s = np.asarray(cameras.scale_px_per_unit)
    principal = np.asarray(reconstruction.image_size_px) / 2.0
    mean_scale = float(np.exp(np.mean(np.log(s))))
    fx = focal_length_px * s / mean_scale if equal_distance else np.full(len(s), focal_length_px)
    obs = reconstruction.observations.select(reconstruction.inlier)
    points = reconstruction.points[obs.track_idx]
    nearest = float(np.max(np.abs(depths_px(cameras, points, obs.image_idx)), initial=0.0))
    if focal_length_px < MIN_DISTANCE * nearest:
        raise UsageError(
            f"a focal length of {focal_length_px:.4g} px puts the cameras into the specimen, which "
            f"is {2 * nearest:.4g} px deep: give a larger --focal_factor"
        )
    K2_inverse = np.linalg.inv(cameras.K2)
    offset = (cameras.translation_px - principal) @ K2_inverse.T / s[:, None]
    views = PinholeViews(
        focal_px=np.column_stack([fx, fx * cameras.aspect]),
        principal_point_px=principal,
        cam_from_world=cameras.cam_from_world,
        translation=np.column_stack([offset, fx / s]),
        focal_length_px=focal_length_px,
        max_deviation_px=0.0,
    )
    ours = cameras.project(points, obs.image_idx)
    gap = np.linalg.norm(views.project(points, obs.image_idx) - ours, axis=1)
    if cameras.skew != 0.0:
        y = np.einsum("oj,oj->o", cameras.cam_from_world[obs.image_idx, 1], points)
        shift = float(np.max(np.abs(cameras.skew * s[obs.image_idx] * y), initial=0.0))
        if shift > MAX_SKEW_DEVIATION_PX:
            raise InputError(
                f"the cameras have a skew of {cameras.skew:.3g}, which a pinhole camera lacks and "
                f"which moves points by up to {shift:.2g} px: map the series without skew to "
                "export it, or use nfh-sem, which holds the orthographic cameras themselves"
            )
    return PinholeViews(
        focal_px=views.focal_px,
        principal_point_px=views.principal_point_px,
        cam_from_world=views.cam_from_world,
        translation=views.translation,
        focal_length_px=focal_length_px,
        max_deviation_px=float(np.max(gap, initial=0.0)),
    )
