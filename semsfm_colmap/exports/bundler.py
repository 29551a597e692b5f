"""Bundler v0.3: bundle.out with bundle.list.txt.

``P = R X + t; p = -P[:2] / P[2]; xy' = f p`` with x right, y up and the camera looking along -z, so
R and t are COLMAP's with the second and third row negated, and a measurement is
``(u - cx, cy - v)``. One focal length a camera, square pixels.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from semsfm_colmap.errors import InputError
from semsfm_colmap.exports.colmap_model import pinhole_summary
from semsfm_colmap.exports.options import FormatOptions
from semsfm_colmap.exports.pinhole import PinholeViews, choose_focal_length, pinhole_views
from semsfm_colmap.exports.scene import ExportScene, Summary
from semsfm_colmap.types import Float

FLIP = np.array([1.0, -1.0, -1.0])


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
    focal = choose_focal_length(scene.reconstruction, scene.focal_length_px, options, float32=False)
    return pinhole_views(scene.reconstruction, focal)


def write(scene: ExportScene, folder: Path, options: FormatOptions) -> Summary:
    """bundle.out and bundle.list.txt"""
    views = square_pixel_views(scene, options, "bundler")
    reconstruction = scene.reconstruction
    lines = ["# Bundle file v0.3", f"{len(scene.names)} {len(reconstruction.points)}"]
    for i in range(len(scene.names)):
        lines.append(f"{views.focal_px[i, 0]:.17g} 0 0")
        lines += [numbers(row) for row in FLIP[:, None] * views.cam_from_world[i]]
        lines.append(numbers(FLIP * views.translation[i]))
    obs = reconstruction.observations.select(reconstruction.inlier)
    centred = (obs.xy - views.principal_point_px[obs.image_idx]) * FLIP[:2]
    bounds = np.searchsorted(obs.track_idx, np.arange(len(reconstruction.points) + 1))
    colors = reconstruction.point_color
    for j, point in enumerate(reconstruction.points):
        rows = range(bounds[j], bounds[j + 1])
        color = (128, 128, 128) if colors is None else colors[j]
        lines.append(numbers(point))
        lines.append(" ".join(str(int(c)) for c in color))
        views_of = [f"{obs.image_idx[o]} {obs.keypoint_idx[o]} {numbers(centred[o])}" for o in rows]
        lines.append(" ".join([str(len(rows)), *views_of]))
    (folder / "bundle.out").write_text("\n".join(lines) + "\n", encoding="utf-8")
    names = "".join(f"{name}\n" for name in scene.names)
    (folder / "bundle.list.txt").write_text(names, encoding="utf-8")
    return pinhole_summary(scene, views)


def numbers(row: Float) -> str:
    """Numbers with all their digits, separated by spaces."""
    return " ".join(f"{value:.17g}" for value in row)
