"""COLMAP models: binary and text in double precision, and a folder for float32 consumers."""

from __future__ import annotations

from pathlib import Path

from semsfm_colmap.colmap.presets import command_lines, project_ini
from semsfm_colmap.exports.model_files import build_pinhole_model, camera_model_for
from semsfm_colmap.exports.options import FormatOptions
from semsfm_colmap.exports.pinhole import PinholeViews, choose_focal_length, pinhole_views
from semsfm_colmap.exports.scene import ExportScene, Summary


def pinhole_summary(scene: ExportScene, views: PinholeViews) -> Summary:
    """The figures that every pinhole export states."""
    return {
        "num_images": len(scene.names),
        "num_points": len(scene.reconstruction.points),
        "focal_length_px": views.focal_length_px,
        "focal_factor": views.focal_length_px / scene.size_px,
        "max_deviation_px": views.max_deviation_px,
    }


def _write(scene: ExportScene, folder: Path, options: FormatOptions, *, text: bool) -> Summary:
    focal = choose_focal_length(scene.reconstruction, scene.focal_length_px, options, float32=False)
    views = pinhole_views(scene.reconstruction, focal)
    model = build_pinhole_model(scene, views, camera_model_for(scene))
    if text:
        model.write_text(str(folder))
    else:
        model.write_binary(str(folder))
    (folder / "project.ini").write_text(project_ini(), encoding="utf-8")
    (folder / "commands.txt").write_text(command_lines(), encoding="utf-8")
    error = float(model.compute_mean_reprojection_error())
    return {**pinhole_summary(scene, views), "mean_reprojection_error_px": error}


def write_binary(scene: ExportScene, folder: Path, options: FormatOptions) -> Summary:
    """cameras, images, points3D, rigs, frames .bin"""
    return _write(scene, folder, options, text=False)


def write_text(scene: ExportScene, folder: Path, options: FormatOptions) -> Summary:
    """cameras, images, points3D, rigs, frames .txt"""
    return _write(scene, folder, options, text=True)


def write_float32(scene: ExportScene, folder: Path, options: FormatOptions) -> Summary:
    """images/ and sparse/0 with PINHOLE cameras: the layout that splatting trainers expect."""
    focal = choose_focal_length(scene.reconstruction, scene.focal_length_px, options, float32=True)
    views = pinhole_views(scene.reconstruction, focal)
    model = build_pinhole_model(scene, views, "PINHOLE")
    sparse = folder / "sparse" / "0"
    sparse.mkdir(parents=True)
    model.write_binary(str(sparse))
    scene.copy_images(folder / "images")
    error = float(model.compute_mean_reprojection_error())
    return {**pinhole_summary(scene, views), "mean_reprojection_error_px": error}
