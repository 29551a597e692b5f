"""PLY: the points of the model with normals toward the viewers and standard deviations."""

from __future__ import annotations

from pathlib import Path

from semsfm_colmap.errors import UsageError
from semsfm_colmap.exports.options import FormatOptions
from semsfm_colmap.exports.scene import ExportScene, Summary


def write(scene: ExportScene, folder: Path, options: FormatOptions) -> Summary:
    """points.ply"""
    if scene.cloud is None or scene.write_ply is None:
        raise UsageError("the scene has no cloud: export through semsfm_colmap.export_project")
    cloud = scene.cloud()
    scene.write_ply(folder / "points.ply", cloud)
    return {
        "num_images": len(scene.names),
        "num_points": len(cloud.points),
        "world_unit": scene.reconstruction.world_unit,
    }
