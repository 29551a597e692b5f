"""The picture of the README, from the project that scripts/example.sh makes.

usage: readme_picture.py [PROJECT] [OUTPUT]
"""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
import numpy as np
import PIL.Image

from semsfm_colmap.colmap.model.sparse import read_model
from semsfm_colmap.io.ply import read_ply_mesh
from semsfm_colmap.surface.mesh.preview import render_mesh, turntable

SIZE = (520, 420)


def main() -> None:
    project = Path(sys.argv[1] if len(sys.argv) > 1 else "out/example/project")
    output = Path(sys.argv[2] if len(sys.argv) > 2 else "docs/images/example.png")
    model = read_model(project / "sparse" / "0")
    middle = model.num_images // 2
    grey = cv2.imread(str(project / "images" / model.image_names[middle]), cv2.IMREAD_GRAYSCALE)
    scale = min(SIZE[0] / grey.shape[1], SIZE[1] / grey.shape[0])
    small = cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    panel = np.full((SIZE[1], SIZE[0], 3), 255, dtype=np.uint8)
    top, left = (SIZE[1] - small.shape[0]) // 2, (SIZE[0] - small.shape[1]) // 2
    panel[top : top + small.shape[0], left : left + small.shape[1]] = small[..., None]
    mesh = read_ply_mesh(project / "mesh" / "mesh.ply")
    R = np.asarray(model.cameras.cam_from_world[middle])
    views = [
        render_mesh(mesh, R, size_px=SIZE),
        render_mesh(mesh, turntable(R, np.array([50.0]))[0], size_px=SIZE),
    ]
    output.parent.mkdir(parents=True, exist_ok=True)
    PIL.Image.fromarray(np.concatenate([panel, *views], axis=1)).save(output, optimize=True)


if __name__ == "__main__":
    main()
