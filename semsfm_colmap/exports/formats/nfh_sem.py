"""Orthographic cameras, depth and normals as npz: for neural fields of SEM series.

NFH-SEM (Chen et al., 2025) starts from multi-view geometry of a SEM series: parallel cameras and
coarse depth. Its loader is not documented, so the layout here is our own (docs/exports.md): plain
arrays under plain names, which a loader of a few lines can take.

``cameras.npz`` holds the orthographic cameras themselves, without any pinhole: it is the one export
with no deviation. ``depth/<name>.npz`` holds depth along the viewing direction and world normals.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from semsfm_colmap.exports.options import FormatOptions
from semsfm_colmap.exports.scene import ExportScene, Summary


def write(scene: ExportScene, folder: Path, options: FormatOptions) -> Summary:
    """cameras.npz, points.npz, depth/, images/, masks/"""
    reconstruction = scene.reconstruction
    cameras = reconstruction.cameras
    projection = np.concatenate([cameras.projection, cameras.translation_px[:, :, None]], axis=2)
    points = reconstruction.points
    center = (points.min(axis=0) + points.max(axis=0)) / 2.0
    radius = float(np.max(np.linalg.norm(points - center, axis=1), initial=0.0))
    pixel_size = reconstruction.pixel_size_um
    np.savez(
        folder / "cameras.npz",
        allow_pickle=False,
        names=np.array(scene.names),
        image_size_px=np.asarray(reconstruction.image_size_px),
        projection=projection,
        cam_from_world=cameras.cam_from_world,
        scale_px_per_unit=cameras.scale_px_per_unit,
        translation_px=cameras.translation_px,
        K2=cameras.K2,
        scene_center=center,
        scene_radius=np.array(radius),
        world_unit=np.array(reconstruction.world_unit),
        pixel_size_um=np.array(np.nan if pixel_size is None else pixel_size),
        has_depth=np.array(_write_depth(scene, folder)),
    )
    obs = reconstruction.observations.select(reconstruction.inlier)
    np.savez(
        folder / "points.npz",
        allow_pickle=False,
        points=points,
        image_idx=obs.image_idx,
        track_idx=obs.track_idx,
        xy=obs.xy,
    )
    scene.copy_images(folder / "images")
    num_masks = scene.copy_masks(folder / "masks")
    return {
        "num_images": len(scene.names),
        "num_points": len(points),
        "num_depth_maps": len(scene.depth_map_names),
        "num_masks": num_masks,
        "max_deviation_px": 0.0,
    }


def _write_depth(scene: ExportScene, folder: Path) -> list[bool]:
    done = [False] * len(scene.names)
    for view in scene.dense_views():
        path = folder / "depth" / f"{scene.names[view.image_idx]}.npz"
        path.parent.mkdir(parents=True, exist_ok=True)
        R = scene.reconstruction.cameras.cam_from_world[view.image_idx]
        world = np.einsum("khw,kj->hwj", view.normal, R)
        arrays = {"depth": view.depth.astype(np.float32), "normal": world.astype(np.float32)}
        if view.confidence is not None:
            arrays["confidence"] = view.confidence.astype(np.float32)
        np.savez_compressed(path, allow_pickle=False, **arrays)
        done[view.image_idx] = True
    return done
