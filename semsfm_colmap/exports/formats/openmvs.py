"""OpenMVS: what InterfaceCOLMAP reads.

It opens ``images/`` and ``sparse/cameras.txt``, ``images.txt`` and ``points3D.txt`` (no ``0``
between) and takes PINHOLE cameras only. OpenMVS keeps cameras in double precision, points and depth
maps in float32, so the focal length is that of the float32 formats.
"""

from __future__ import annotations

from pathlib import Path

from semsfm_colmap.exports.colmap_files import write_model
from semsfm_colmap.exports.options import FormatOptions
from semsfm_colmap.exports.pinhole import scene_views
from semsfm_colmap.exports.scene import ExportScene, Summary


def write(scene: ExportScene, folder: Path, options: FormatOptions) -> Summary:
    """images/ and sparse/ with text files."""
    views = scene_views(scene, options, float32=True)
    summary = write_model(scene, views, folder / "sparse", text=True, camera_model="PINHOLE")
    scene.copy_images(folder / "images", rgb=not options.grey_images)
    return summary
