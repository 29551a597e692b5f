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

from semsfm_colmap.colmap.model.telecentric import (
    PinholeCameras,
    depths_px,
    pinhole_cameras,
    required_focal_length,
)
from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.exports.options import FormatOptions
from semsfm_colmap.exports.scene import ExportScene, Summary
from semsfm_colmap.types import Reconstruction

MIN_DISTANCE = 4.0
"""No camera nearer than so many times the largest depth: `telecentric.py` keeps to the same."""
MAX_SKEW_DEVIATION_PX = 0.5
"""A pinhole has no skew; a model whose skew moves an observation further is refused."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PinholeViews(PinholeCameras):
    """The pinholes of an export, and how far they are from the cameras that they stand for."""

    focal_length_px: float
    """The nominal focal length: the focal length of an image of geometric mean magnification"""
    max_deviation_px: float
    """Largest distance to the orthographic cameras over the inlier observations"""


def choose_focal_length(
    reconstruction: Reconstruction, own_focal_px: float, options: FormatOptions, *, float32: bool
) -> float:
    """The focal length in px for a consumer in double precision or in float32.

    `own_focal_px` is that of the project's sparse model.
    """
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
        k = (options.min_float32_focal_factor, options.max_float32_focal_factor)
        focal = float(np.clip(focal, k[0] * size, k[1] * size))
    return focal


def scene_views(
    scene: ExportScene, options: FormatOptions, *, float32: bool, equal_distance: bool = False
) -> PinholeViews:
    """The pinholes of a scene for a consumer in double precision or in float32."""
    reconstruction = scene.reconstruction
    focal = choose_focal_length(reconstruction, scene.focal_length_px, options, float32=float32)
    return pinhole_views(reconstruction, focal, equal_distance=equal_distance)


def square_pixel_views(
    scene: ExportScene, options: FormatOptions, format_name: str
) -> PinholeViews:
    """Pinholes with one focal length each, or the reason why the format cannot hold the cameras."""
    aspect = scene.reconstruction.cameras.aspect
    if aspect != 1.0:
        raise InputError(
            f"{format_name} holds square pixels only and the cameras have the aspect {aspect:.5g}: "
            "use colmap-bin, or map the series with square pixels"
        )
    return scene_views(scene, options, float32=False)


def pinhole_summary(scene: ExportScene, views: PinholeViews) -> Summary:
    """The figures that every pinhole export states."""
    return {
        "num_images": len(scene.names),
        "num_points": len(scene.reconstruction.points),
        "focal_length_px": views.focal_length_px,
        "focal_factor": views.focal_length_px / scene.size_px,
        "max_deviation_px": views.max_deviation_px,
    }


def pinhole_views(
    reconstruction: Reconstruction, focal_length_px: float, *, equal_distance: bool = False
) -> PinholeViews:
    """Pinholes of a focal length, and their distance to the cameras of the reconstruction.

    A focal length that puts them into the specimen is refused, and so is a skew that shows.
    """
    cameras = reconstruction.cameras
    obs = reconstruction.observations.select(reconstruction.inlier)
    points = reconstruction.points[obs.track_idx]
    nearest = float(np.max(np.abs(depths_px(cameras, points, obs.image_idx)), initial=0.0))
    if focal_length_px < MIN_DISTANCE * nearest:
        raise UsageError(
            f"a focal length of {focal_length_px:.4g} px puts the cameras into the specimen, which "
            f"is {2 * nearest:.4g} px deep: give a larger --focal_factor"
        )
    pinholes = pinhole_cameras(
        cameras, reconstruction.image_size_px, focal_length_px, equal_distance=equal_distance
    )
    ours = cameras.project(points, obs.image_idx)
    gap = np.linalg.norm(pinholes.project(points, obs.image_idx) - ours, axis=1)
    if cameras.skew != 0.0:
        y = np.einsum("oj,oj->o", cameras.cam_from_world[obs.image_idx, 1], points)
        scale = cameras.scale_px_per_unit[obs.image_idx]
        shift = float(np.max(np.abs(cameras.skew * scale * y), initial=0.0))
        if shift > MAX_SKEW_DEVIATION_PX:
            raise InputError(
                f"the cameras have a skew of {cameras.skew:.3g}, which a pinhole camera lacks and "
                f"which moves points by up to {shift:.2g} px: map the series without skew to "
                "export it, or use nfh-sem, which holds the orthographic cameras themselves"
            )
    return PinholeViews(
        focal_px=pinholes.focal_px,
        principal_point_px=pinholes.principal_point_px,
        cam_from_world=pinholes.cam_from_world,
        translation=pinholes.translation,
        focal_length_px=focal_length_px,
        max_deviation_px=float(np.max(gap, initial=0.0)),
    )
