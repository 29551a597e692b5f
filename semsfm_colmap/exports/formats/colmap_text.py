"""A COLMAP model, text, in double precision."""

from __future__ import annotations

from pathlib import Path

from semsfm_colmap.exports.colmap_files import write_telecentric
from semsfm_colmap.exports.options import FormatOptions
from semsfm_colmap.exports.scene import ExportScene, Summary


def write(scene: ExportScene, folder: Path, options: FormatOptions) -> Summary:
    """cameras, images, points3D, rigs, frames .txt"""
    return write_telecentric(scene, folder, options, text=True)
