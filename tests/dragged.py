"""Simulated series of a smooth body whose features are dragged by shading."""

from dataclasses import dataclass, replace

import numpy as np

from semsfm_colmap.geometry.rotations import rotation_from_vector
from semsfm_colmap.refinement.drag import drag_field
from semsfm_colmap.refinement.options import RefinementOptions
from semsfm_colmap.refinement.refine import refine
from semsfm_colmap.types import Observations, OrthographicCameras

RADIUS_PX = 150.0


@dataclass(frozen=True)
class Scene:
    cameras: OrthographicCameras
    points: np.ndarray
    normals: np.ndarray
    observations: Observations
    """with noise and drag"""


def dragged_scene(drag_px, *, num_images=16, range_deg=100.0, num_points=1200, noise_px=0.1, seed=0,
                  mount_deg=None, extra=None):  # fmt: skip
    """An ellipsoid turned about an axis near y; `extra` (R, n, i, j) displaces observations too.

    With `mount_deg` there is a second series of as many images, the body mounted at that angle
    about the line of sight.
    """
    rng = np.random.default_rng(seed)
    half = np.deg2rad(range_deg) / 2
    axis = np.array([0.02, 1.0, 0.03])
    R = rotation_from_vector(np.linspace(-half, half, num_images)[:, None] * axis)
    series = None
    if mount_deg is not None:
        series = np.repeat([0, 1], num_images)
        R = np.concatenate([R, R @ rotation_from_vector(np.array([0, 0, np.deg2rad(mount_deg)]))])
        num_images *= 2
    unit = rng.normal(size=(num_points, 3))
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    semi = np.array([1.0, 1.2, 0.8])
    points = RADIUS_PX * unit * semi
    normals = unit / semi
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    facing = (normals @ R[:, 2].T) < -0.4
    facing &= (facing.sum(axis=1) >= 4)[:, None]
    track, image = np.nonzero(facing)
    used, track = np.unique(track, return_inverse=True)
    points, normals = points[used], normals[used]
    cameras = OrthographicCameras(
        cam_from_world=R,
        scale_px_per_unit=np.ones(num_images),
        translation_px=200.0 + 5.0 * rng.normal(size=(num_images, 2)),
        series_idx=series,
    )
    xy = cameras.project(points[track], image) + noise_px * rng.normal(size=(len(track), 2))
    xy = xy + drag_px * drag_field(R, normals, image, track)
    if extra is not None:
        xy = xy + extra(R, normals, image, track)
    observations = Observations(
        image_idx=image,
        track_idx=track,
        keypoint_idx=np.arange(len(track)),
        xy=xy,
        num_images=num_images,
        num_tracks=len(used),
    )
    return Scene(cameras, points, normals, observations)


def refined(scene, **options):
    """The scene's observations, refined from the true cameras."""
    chosen = replace(RefinementOptions(), filter_thresholds_px=(2.0, 1.0), **options)
    found = refine(
        scene.cameras,
        np.arange(len(scene.cameras)),
        scene.observations,
        chosen,
        rng=np.random.default_rng(0),
        series_idx=scene.cameras.series_idx,
    )
    return found.value
