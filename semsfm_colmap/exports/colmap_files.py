"""COLMAP models of a scene, for the formats that hold one."""

from __future__ import annotations

from pathlib import Path

from semsfm_colmap.colmap.model.build import build_model
from semsfm_colmap.colmap.presets import command_lines, project_ini
from semsfm_colmap.exports.options import FormatOptions
from semsfm_colmap.exports.pinhole import PinholeViews, pinhole_summary, scene_views
from semsfm_colmap.exports.scene import ExportScene, Summary


def write_model(
    scene: ExportScene,
    views: PinholeViews,
    folder: Path,
    *,
    text: bool = False,
    camera_model: str | None = None,
) -> Summary:
    """cameras, images, points3D, rigs, frames .bin or .txt, as pinholes see the scene."""
    model = build_model(
        scene.reconstruction, views, scene.names, scene.image_ids, scene.keypoints, camera_model
    )
    folder.mkdir(parents=True, exist_ok=True)
    if text:
        model.write_text(str(folder))
    else:
        model.write_binary(str(folder))
    error = float(model.compute_mean_reprojection_error())
    return {**pinhole_summary(scene, views), "mean_reprojection_error_px": error}


def write_telecentric(
    scene: ExportScene, folder: Path, options: FormatOptions, *, text: bool = False
) -> Summary:
    """The model in double precision, with the settings that COLMAP's programs need for it."""
    summary = write_model(scene, scene_views(scene, options, float32=False), folder, text=text)
    (folder / "project.ini").write_text(project_ini(), encoding="utf-8")
    (folder / "commands.txt").write_text(command_lines(), encoding="utf-8")
    return summary
