"""From a folder of images to cameras, points and a mesh, and back into numpy.

    python examples/quick_start.py [IMAGES] [PROJECT]

Without arguments a small series of a spiny grain is rendered first, whose truth is known.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import semsfm_colmap as semsfm


def main(image_path: Path, project_path: Path) -> None:
    """Reconstruct a series and print what a script would go on with."""
    record = semsfm.reconstruct(image_path, project_path)
    print("stages:", ", ".join(record.stages))

    model = semsfm.read_model(project_path / "sparse" / "0")
    residuals = model.residuals()[model.inlier]
    rms_px = float(np.sqrt((residuals**2).sum(axis=1).mean()))
    print(f"{model.num_images} cameras, {len(model.points)} points, {rms_px:.2f} px RMS")
    # every camera is x = scale * (R X)[:2] + t; lengths are in model.world_unit
    R = model.cameras.cam_from_world
    turn_deg = np.rad2deg(np.arccos(np.clip((np.trace(R[0].T @ R[-1]) - 1) / 2, -1, 1)))
    print(f"first to last image: {turn_deg:.1f} degrees; lengths in {model.world_unit}")
    print(f"mesh: {project_path / 'mesh' / 'mesh.ply'}")


if __name__ == "__main__":
    if len(sys.argv) > 1:
        images, project = Path(sys.argv[1]), Path(sys.argv[2])
    else:
        folder = Path("out/quick_start")
        images, project = folder / "images", folder / "project"
        if not images.is_dir():
            semsfm.synthesize(folder, semsfm.SynthesizeOptions(num_images=24, range_deg=115.0))
    main(images, project)
