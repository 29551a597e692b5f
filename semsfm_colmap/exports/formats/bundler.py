"""Bundler v0.3: bundle.out with bundle.list.txt.

``P = R X + t; p = -P[:2] / P[2]; xy' = f p`` with x right, y up and the camera looking along -z, so
R and t are COLMAP's with the second and third row negated, and a measurement is
``(u - cx, cy - v)``. One focal length a camera, square pixels.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from semsfm_colmap.exports.numbers import digits
from semsfm_colmap.exports.options import FormatOptions
from semsfm_colmap.exports.pinhole import pinhole_summary, square_pixel_views
from semsfm_colmap.exports.scene import ExportScene, Summary

FLIP = np.array([1.0, -1.0, -1.0])


def write(scene: ExportScene, folder: Path, options: FormatOptions) -> Summary:
    """bundle.out and bundle.list.txt"""
    views = square_pixel_views(scene, options, "bundler")
    reconstruction = scene.reconstruction
    lines = ["# Bundle file v0.3", f"{len(scene.names)} {len(reconstruction.points)}"]
    for i in range(len(scene.names)):
        lines.append(f"{views.focal_px[i, 0]:.17g} 0 0")
        lines += [digits(row) for row in FLIP[:, None] * views.cam_from_world[i]]
        lines.append(digits(FLIP * views.translation[i]))
    obs = reconstruction.observations.select(reconstruction.inlier)
    centred = (obs.xy - views.principal_point_px[obs.image_idx]) * FLIP[:2]
    bounds = np.searchsorted(obs.track_idx, np.arange(len(reconstruction.points) + 1))
    colors = reconstruction.point_color
    for j, point in enumerate(reconstruction.points):
        rows = range(bounds[j], bounds[j + 1])
        color = (128, 128, 128) if colors is None else colors[j]
        lines.append(digits(point))
        lines.append(" ".join(str(int(c)) for c in color))
        views_of = [f"{obs.image_idx[o]} {obs.keypoint_idx[o]} {digits(centred[o])}" for o in rows]
        lines.append(" ".join([str(len(rows)), *views_of]))
    (folder / "bundle.out").write_text("\n".join(lines) + "\n", encoding="utf-8")
    names = "".join(f"{name}\n" for name in scene.names)
    (folder / "bundle.list.txt").write_text(names, encoding="utf-8")
    return pinhole_summary(scene, views)
