"""A finished project of a textured ball in closed form: images, model, depth maps, databases."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from semsfm_colmap.colmap.database.work import DatabaseImage
from semsfm_colmap.colmap.library import pycolmap
from semsfm_colmap.colmap.model.sparse import write_model
from semsfm_colmap.colmap.options import ExportOptions
from semsfm_colmap.io.ply import write_ply
from semsfm_colmap.refinement.adjustment import BundleSettings
from semsfm_colmap.refinement.bundle import bundle_adjust
from semsfm_colmap.surface.files import write_depth_map
from semsfm_colmap.surface.mesh.from_cloud import mesh_cloud
from semsfm_colmap.surface.options import SurfaceOptions
from semsfm_colmap.types import DepthSign, PointCloud, Reconstruction
from tests.colmap.databases import Content, write_4x, write_38
from tests.surface.scene import (
    HEIGHT,
    RADIUS,
    SCALE,
    WIDTH,
    ball_depth_maps,
    ball_points,
    ball_reconstruction,
    picture,
    turning_cameras,
)

ANGLES = list(np.arange(0.0, 110.0, 10.0))
SPECIAL_NAMES = ("a b.png", "ü.png", "sub/c.png", "sub/über d.png")
"""A space, unicode, a subfolder, all of it"""
NOISE_PX = 0.1
EXPORT = ExportOptions(max_deviation_px=0.004)
"""In proportion to a ball of 44 px: bundle adjusters follow the perspective that is left."""
UNIT = 0.05
"""Micrometres in a unit of tests.surface.scene"""


def image_names(special: bool) -> tuple[str, ...]:
    """Names of all images, the first four special or none."""
    plain = tuple(f"view_{i:02d}.png" for i in range(len(ANGLES)))
    return SPECIAL_NAMES + plain[len(SPECIAL_NAMES) :] if special else plain


def ball(names: tuple[str, ...], *, aspect: float = 1.0, num_points: int = 1500) -> Reconstruction:
    """The ball with noisy observations, in micrometres, magnifications drifting a little."""
    rng = np.random.default_rng(3)
    cameras = turning_cameras(ANGLES, aspect=aspect)
    drift = np.exp(5e-4 * rng.normal(size=len(ANGLES)))
    cameras = replace(cameras, scale_px_per_unit=cameras.scale_px_per_unit * drift)
    made = ball_reconstruction(cameras, names, num_points)
    long = np.bincount(made.observations.track_idx, minlength=len(made.points)) >= 3
    obs = made.observations.select(long[made.observations.track_idx])
    # COLMAP's triangulator leaves out what two images see
    obs = replace(obs, track_idx=(np.cumsum(long) - 1)[obs.track_idx], num_tracks=int(long.sum()))
    keypoint = np.empty(len(obs), dtype=np.int64)
    for i in range(len(names)):
        rows = np.flatnonzero(obs.image_idx == i)
        # one keypoint in each image that no point owns
        keypoint[rows] = np.arange(len(rows)) + 1
    xy = obs.xy + NOISE_PX * rng.normal(size=obs.xy.shape)
    obs = replace(obs, xy=xy, keypoint_idx=keypoint)
    # the optimum of these observations, in a world of px, as `semsfm map` would hand it on
    in_px = replace(cameras, scale_px_per_unit=cameras.scale_px_per_unit / SCALE)
    solution = bundle_adjust(in_px, obs, BundleSettings(scale_sigma=0.01, sigma_px=NOISE_PX))
    assert solution.value is not None
    cameras, points = solution.value.cameras, solution.value.points
    return replace(
        made,
        cameras=replace(cameras, scale_px_per_unit=cameras.scale_px_per_unit * SCALE / UNIT),
        points=points * UNIT / SCALE,
        observations=obs,
        inlier=np.ones(len(obs), dtype=bool),
        point_color=rng.integers(0, 255, (len(points), 3), dtype=np.uint8),
        world_unit="um",
        pixel_size_um=UNIT / SCALE,
        pixel_size_source="test",
        depth_sign=DepthSign(status="resolved", confidence=0.99),
        gauge="as made",
    )


def keypoints_of(reconstruction: Reconstruction) -> dict[str, np.ndarray]:
    """All keypoints of each image: one that no point owns, then those of the observations."""
    obs = reconstruction.observations
    return {
        name: np.vstack([[1.5, 2.5], obs.xy[obs.image_idx == i]])
        for i, name in enumerate(reconstruction.image_names)
    }


def write_project(path: Path, *, special: bool) -> Path:
    """Everything that an export may read, at the places of docs/files.md."""
    names = image_names(special)
    made = ball(names)
    database_images = {
        name: DatabaseImage(image_id=3 + i, name=name, camera_id=1) for i, name in enumerate(names)
    }
    keypoints = keypoints_of(made)
    write_model(made, path / "sparse" / "0", database_images, keypoints, EXPORT)
    maps = ball_depth_maps(turning_cameras(ANGLES), names)
    for i, depth_map in enumerate(maps):
        image = picture(turning_cameras(ANGLES), i, np.asarray(depth_map.depth, float), 2.0, 5)
        target = path / "images" / names[i]
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(cv2.imencode(".png", image)[1].tobytes())
        scaled = replace(depth_map, depth=(depth_map.depth * UNIT).astype(np.float32))
        write_depth_map(path / "dense" / "depth_maps", scaled)
    write_ply(path / "dense" / "fused.ply", PointCloud(points=made.points))
    around = ball_points(1500)
    cloud = PointCloud(points=around * UNIT, normals=around / RADIUS)
    write_ply(path / "mesh" / "mesh.ply", mesh_cloud(cloud, SurfaceOptions()))
    write_4x(path / "database.db", database_content(made))
    return path


def database_content(reconstruction: Reconstruction) -> Content:
    """Keypoints and the matches of all tracks, as a matcher without mistakes would fill them."""
    obs = reconstruction.observations
    num = reconstruction.num_images
    keypoint = np.full((num, obs.num_tracks), -1, dtype=np.int64)
    keypoint[obs.image_idx, obs.track_idx] = obs.keypoint_idx
    matches = {}
    for i in range(num):
        for j in range(i + 1, min(i + 5, num)):
            both = (keypoint[i] >= 0) & (keypoint[j] >= 0)
            if both.sum() > 10:
                matches[i, j] = np.column_stack([keypoint[i][both], keypoint[j][both]])
    rows = keypoints_of(reconstruction)
    extra = [1.0, 0.0, 0.0, 1.0]
    return Content(
        names=reconstruction.image_names,
        ids=tuple(3 + i for i in range(num)),
        size=(WIDTH, HEIGHT),
        keypoints=tuple(
            np.hstack([rows[name], np.tile(extra, (len(rows[name]), 1))])
            for name in reconstruction.image_names
        ),
        raw=matches,
        verified=matches,
    )


def write_databases(folder: Path, reconstruction: Reconstruction) -> tuple[Path, Path]:
    """A database of COLMAP 3.8 and one of the installed pycolmap, with the project's camera."""
    content = database_content(reconstruction)
    paths = write_38(folder / "d38.db", content), write_4x(folder / "d4.db", content)
    with pycolmap.Database.open(str(paths[1])) as db:
        camera = db.read_all_cameras()[0]
        camera.model = pycolmap.CameraModelId.SIMPLE_PINHOLE
        camera.params = [1e5, WIDTH / 2, HEIGHT / 2]
        db.update_camera(camera)
    return paths
