"""COLMAP's layout for programs in float32: the folder that splatting trainers expect."""

from __future__ import annotations

from pathlib import Path

from semsfm_colmap.exports.colmap_files import write_model
from semsfm_colmap.exports.options import FormatOptions
from semsfm_colmap.exports.pinhole import scene_views
from semsfm_colmap.exports.scene import ExportScene, Summary


def write(scene: ExportScene, folder: Path, options: FormatOptions) -> Summary:
    """images/ and sparse/0 with PINHOLE cameras"""
    views = scene_views(scene, options, float32=True)
    summary = write_model(scene, views, folder / "sparse" / "0", camera_model="PINHOLE")
    scene.copy_images(folder / "images", rgb=not options.grey_images)
    return summary
