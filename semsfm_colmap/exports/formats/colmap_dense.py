"""COLMAP's dense workspace with our depth and normal maps in it.

``images/``, ``sparse/`` (PINHOLE), ``stereo/patch-match.cfg``, ``stereo/fusion.cfg``,
``stereo/depth_maps`` and ``normal_maps`` with ``<name>.geometric.bin``, ``project.ini``,
``commands.txt``: ``stereo_fusion``, ``poisson_mesher``, ``delaunay_mesher`` and the GUI go on
from here, and ``patch_match_stereo`` can start anew.

All cameras stand at the same distance, each image's magnification being in its focal length, so
one depth range fits all of them. Fusion computes in float32: at a distance of D px its points are
good to some 2e-7 D.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from semsfm_colmap.colmap.dense_map import pinhole_depth, write_map
from semsfm_colmap.colmap.presets import DensePreset, command_lines, project_ini
from semsfm_colmap.exports.colmap_files import write_model
from semsfm_colmap.exports.dense import DenseView
from semsfm_colmap.exports.options import FormatOptions
from semsfm_colmap.exports.pinhole import PinholeViews, scene_views
from semsfm_colmap.exports.scene import ExportScene, Summary
from semsfm_colmap.types import Int, OrthographicCameras

DEPTH_MARGIN = 0.25
"""PatchMatch searches this share of the points' depth range beyond it, at both ends."""


def write(scene: ExportScene, folder: Path, options: FormatOptions) -> Summary:
    """The whole workspace."""
    views = scene_views(scene, options, float32=True, equal_distance=True)
    stereo = folder / "stereo"
    for name in ("depth_maps", "normal_maps", "consistency_graphs"):
        (stereo / name).mkdir(parents=True)
    summary = write_model(scene, views, folder / "sparse", camera_model="PINHOLE")
    scene.copy_images(folder / "images")
    num_masks = scene.copy_masks(folder / "masks")
    written = [_write_maps(scene, view, views, stereo) for view in scene.dense_views()]
    _write_lines(stereo / "fusion.cfg", [name for name, _ in written] or list(scene.names))
    _write_lines(stereo / "patch-match.cfg", _problems(scene, options))
    low, high = depth_range(scene, views)
    # the error is relative to the depth of a pixel of the map, the coarsest one counting
    px = max((unit for _, unit in written), default=1.0)
    preset = DensePreset(
        depth_min=low,
        depth_max=high,
        max_depth_error=options.fusion_consistency_px * px / views.focal_length_px,
        min_num_pixels=options.min_fusion_pixels,
    )
    (folder / "project.ini").write_text(project_ini(preset), encoding="utf-8")
    (folder / "commands.txt").write_text(command_lines(preset), encoding="utf-8")
    summary |= {
        "num_depth_maps": len(written),
        "num_masks": num_masks,
        "depth_min": low,
        "depth_max": high,
        "max_depth_error": preset.max_depth_error,
        "min_num_pixels": preset.min_num_pixels,
    }
    if not written:
        summary["notes"] = ["there are no depth maps: run `semsfm densify`, then export again"]
    return summary


def _write_maps(
    scene: ExportScene, view: DenseView, views: PinholeViews, stereo: Path
) -> tuple[str, float]:
    """The two maps of an image; its name and the px of the image that a px of the map covers."""
    i = view.image_idx
    size = np.asarray(scene.reconstruction.image_size_px[i], dtype=np.float64)
    scaling = np.array(view.depth.shape[::-1]) / size
    depth = pinhole_depth(
        view.depth,
        view.slope,
        scaling=scaling,
        scale_px_per_unit=float(scene.reconstruction.cameras.scale_px_per_unit[i]),
        focal_px=float(views.focal_px[i, 0]),
        distance=float(views.translation[i, 2]),
        principal_point_px=views.principal_point_px[i],
    )
    known = (depth > 0) & np.isfinite(view.normal).all(axis=0)
    normal = np.where(known, view.normal, 0.0)
    for kind, values in (("depth_maps", depth * known), ("normal_maps", normal.transpose(1, 2, 0))):
        path = stereo / kind / f"{scene.names[i]}.geometric.bin"
        path.parent.mkdir(parents=True, exist_ok=True)
        write_map(path, values)
    return scene.names[i], float(1.0 / scaling.min())


def _write_lines(path: Path, lines: list[str]) -> None:
    path.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")


def _problems(scene: ExportScene, options: FormatOptions) -> list[str]:
    """patch-match.cfg: a line with the reference, a line with its sources, separated by commas."""
    lines: list[str] = []
    for i, name in enumerate(scene.names):
        sources = source_images(scene.reconstruction.cameras, i, options)
        if len(sources):
            lines += [name, ", ".join(scene.names[j] for j in sources)]
    return lines


def source_images(cameras: OrthographicCameras, reference: int, options: FormatOptions) -> Int:
    """The images with the nearest viewing directions: (V,) image indices by angle."""
    d = cameras.viewing_direction
    cross = np.linalg.norm(np.cross(d, d[reference]), axis=1)
    angle = np.arctan2(cross, d @ d[reference])
    order = np.argsort(angle, kind="stable")
    order = order[order != reference]
    near = order[angle[order] <= np.radians(options.max_source_angle_deg)]
    chosen = near if len(near) else order[:2]
    return np.asarray(chosen[: options.num_source_images], dtype=np.int64)


def depth_range(scene: ExportScene, views: PinholeViews) -> tuple[float, float]:
    """Nearest and farthest depth of the points in any camera, widened, in world units."""
    reconstruction = scene.reconstruction
    obs = reconstruction.observations.select(reconstruction.inlier)
    direction = reconstruction.cameras.viewing_direction[obs.image_idx]
    z = np.einsum("oj,oj->o", direction, reconstruction.points[obs.track_idx])
    z = z + views.translation[obs.image_idx, 2]
    low, high = (float(v) for v in (z.min(), z.max()))
    margin = DEPTH_MARGIN * (high - low)
    return low - margin, high + margin
