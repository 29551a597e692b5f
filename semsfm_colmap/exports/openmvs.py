"""OpenMVS: what InterfaceCOLMAP reads.

It opens ``images/`` and ``sparse/cameras.txt``, ``images.txt`` and ``points3D.txt`` (no ``0``
between) and takes PINHOLE cameras only. OpenMVS keeps cameras in double precision, points and depth
maps in float32, so the focal length is that of the float32 formats.
"""

from __future__ import annotations

from pathlib import Path

from semsfm_colmap.exports.colmap_model import pinhole_summary
from semsfm_colmap.exports.model_files import build_pinhole_model
from semsfm_colmap.exports.options import FormatOptions
from semsfm_colmap.exports.pinhole import choose_focal_length, pinhole_views
from semsfm_colmap.exports.scene import ExportScene, Summary


def write(scene: ExportScene, folder: Path, options: FormatOptions) -> Summary:
    """images/ and sparse/ with text files."""
    focal = choose_focal_length(scene.reconstruction, scene.focal_length_px, options, float32=True)
    views = pinhole_views(scene.reconstruction, focal)
    model = build_pinhole_model(scene, views, "PINHOLE")
    (folder / "sparse").mkdir()
    model.write_text(str(folder / "sparse"))
    scene.copy_images(folder / "images")
    error = float(model.compute_mean_reprojection_error())
    return {**pinhole_summary(scene, views), "mean_reprojection_error_px": error}
