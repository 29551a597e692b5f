"""VisualSFM's NVM_V3.

A camera line is ``name f qw qx qy qz Cx Cy Cz k 0`` with the rotation from world to camera and the
camera's place C; a point line ``X Y Z R G B n (image keypoint x y) ...`` with measurements relative
to the image centre. One focal length a camera, square pixels. A blank follows the first word:
MeshLab looks for one, and ends with a segmentation fault without it.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from semsfm_colmap.colmap.model.build import quaternion_wxyz
from semsfm_colmap.exports.numbers import digits
from semsfm_colmap.exports.options import FormatOptions
from semsfm_colmap.exports.pinhole import pinhole_summary, square_pixel_views
from semsfm_colmap.exports.scene import ExportScene, Summary


def write(scene: ExportScene, folder: Path, options: FormatOptions) -> Summary:
    """model.nvm"""
    views = square_pixel_views(scene, options, "nvm")
    reconstruction = scene.reconstruction
    lines = ["NVM_V3 ", "", str(len(scene.names))]
    for i, name in enumerate(scene.names):
        turn = quaternion_wxyz(views.cam_from_world[i])
        pose = np.array([views.focal_px[i, 0], *turn, *views.centers[i]])
        lines.append(f"{name} {digits(pose)} 0 0")
    lines += ["", str(len(reconstruction.points))]
    obs = reconstruction.observations.select(reconstruction.inlier)
    centred = obs.xy - views.principal_point_px[obs.image_idx]
    bounds = np.searchsorted(obs.track_idx, np.arange(len(reconstruction.points) + 1))
    colors = reconstruction.point_color
    for j, point in enumerate(reconstruction.points):
        rows = range(bounds[j], bounds[j + 1])
        color = (128, 128, 128) if colors is None else colors[j]
        measured = [f"{obs.image_idx[o]} {obs.keypoint_idx[o]} {digits(centred[o])}" for o in rows]
        rgb = " ".join(str(int(c)) for c in color)
        lines.append(" ".join([digits(point), rgb, str(len(rows)), *measured]))
    # a last section without PLY models ends the file
    lines += ["", "0"]
    (folder / "model.nvm").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return pinhole_summary(scene, views)
