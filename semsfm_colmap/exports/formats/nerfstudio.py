"""nerfstudio: transforms.json, images/ and sparse_pc.ply.

Its cameras have x right, y up and look along -z: ``transform_matrix`` is camera to world with
COLMAP's second and third axis negated. Pixel centres lie at 0.5, as COLMAP's do. Its parser shrinks
the scene so that the cameras fit into a cube, which makes a specimen seen from k image widths away
k times smaller: train with ``--auto-scale-poses False --center-method none --orientation-method
none`` (docs/exports.md). The world is scaled here so that the points fill a cube of side 2.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from semsfm_colmap.exports.options import FormatOptions
from semsfm_colmap.exports.pinhole import pinhole_summary, scene_views
from semsfm_colmap.exports.scene import ExportScene, Summary
from semsfm_colmap.io.ply import write_ply
from semsfm_colmap.types import PointCloud

FLIP = np.array([1.0, -1.0, -1.0])


def write(scene: ExportScene, folder: Path, options: FormatOptions) -> Summary:
    """transforms.json, images/ and sparse_pc.ply"""
    reconstruction = scene.reconstruction
    views = scene_views(scene, options, float32=True)
    # a power of two changes no digit of the world's coordinates
    extent = float(np.max(np.abs(reconstruction.points), initial=0.0)) or 1.0
    scale = 2.0 ** -np.ceil(np.log2(extent))
    frames = []
    for i, name in enumerate(scene.names):
        pose = np.eye(4)
        pose[:3, :3] = views.cam_from_world[i].T * FLIP
        pose[:3, 3] = scale * views.centers[i]
        width, height = (int(v) for v in reconstruction.image_size_px[i])
        frames.append(
            {
                "file_path": f"images/{name}",
                "w": width,
                "h": height,
                "fl_x": float(views.focal_px[i, 0]),
                "fl_y": float(views.focal_px[i, 1]),
                "cx": float(views.principal_point_px[i, 0]),
                "cy": float(views.principal_point_px[i, 1]),
                "transform_matrix": pose.tolist(),
                "colmap_im_id": scene.image_ids[i],
            }
        )
    distance = scale * float(np.median(views.translation[:, 2]))
    data = {
        "camera_model": "OPENCV",
        **dict.fromkeys(("k1", "k2", "p1", "p2"), 0.0),
        "ply_file_path": "sparse_pc.ply",
        "frames": frames,
        # what a program needs to come back to the project's units; nerfstudio skips these
        "semsfm_world_scale": scale,
        "semsfm_world_unit": reconstruction.world_unit,
        "semsfm_camera_distance": distance,
    }
    (folder / "transforms.json").write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
    colors = reconstruction.point_color
    grey = np.full((len(reconstruction.points), 3), 128, dtype=np.uint8)
    cloud = PointCloud(
        points=scale * reconstruction.points, colors=grey if colors is None else colors
    )
    write_ply(folder / "sparse_pc.ply", cloud)
    scene.copy_images(folder / "images", rgb=not options.grey_images)
    return {**pinhole_summary(scene, views), "world_scale": scale, "camera_distance": distance}
