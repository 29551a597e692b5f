"""PLY: the points of the model with normals toward the viewers and standard deviations."""

from __future__ import annotations

from pathlib import Path

from semsfm_colmap.exports.cloud import oriented_points
from semsfm_colmap.exports.options import FormatOptions
from semsfm_colmap.exports.scene import ExportScene, Summary
from semsfm_colmap.io.ply import write_ply


def write(scene: ExportScene, folder: Path, options: FormatOptions) -> Summary:
    """points.ply"""
    cloud = oriented_points(scene.reconstruction)
    write_ply(folder / "points.ply", cloud)
    return {
        "num_images": len(scene.names),
        "num_points": len(cloud.points),
        "world_unit": scene.reconstruction.world_unit,
    }
