"""The picture of docs/surface.md: one project meshed by each method, seen from two sides.

usage: surface_picture.py [PROJECT] [OUTPUT]
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import PIL.Image

from semsfm_colmap.config import config_from_dict
from semsfm_colmap.io.ply import read_ply_cloud
from semsfm_colmap.pipeline.project import Project
from semsfm_colmap.surface.files import project_views
from semsfm_colmap.surface.mesh.from_cloud import mesh_cloud
from semsfm_colmap.surface.mesh.methods.registry import METHODS
from semsfm_colmap.surface.mesh.preview import render_mesh, turntable

SIZE = (250, 220)


def main() -> None:
    project = Project(Path(sys.argv[1] if len(sys.argv) > 1 else "out/example/project"))
    output = Path(sys.argv[2] if len(sys.argv) > 2 else "docs/images/surface_methods.png")
    model = project.read_main_model()
    cloud = read_ply_cloud(project.dense / "fused.ply")
    views = project_views(model, project.dense / "depth_maps")
    R = np.asarray(model.cameras.cam_from_world[model.num_images // 2])
    columns = []
    for name in METHODS:
        options = config_from_dict({"surface": {"method": name}}).surface
        mesh = mesh_cloud(cloud, options, views)
        turned = turntable(R, np.array([0.0, 70.0]))
        columns.append(np.concatenate([render_mesh(mesh, V, size_px=SIZE) for V in turned]))
    output.parent.mkdir(parents=True, exist_ok=True)
    PIL.Image.fromarray(np.concatenate(columns, axis=1)).save(output, optimize=True)


if __name__ == "__main__":
    main()
