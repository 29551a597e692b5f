"""A mesh of any COLMAP folder, perspective or parallel: sparse alone, or with its dense workspace.

    python examples/mesh_colmap_folder.py WORKSPACE [OUTPUT]

Nothing in the workspace is changed; the default output is WORKSPACE/mesh_semsfm.
"""

from __future__ import annotations

import sys
from pathlib import Path

import semsfm_colmap as semsfm


def main(workspace: Path, output_path: Path | None = None) -> None:
    """Mesh the folder and say where the surface came from."""
    record = semsfm.mesh_colmap(workspace, output_path)
    mesh, unit = record.mesh, record.world_unit or "units of the model"
    print(f"{record.num_points} points from {record.source} of {record.model_path}")
    print(f"{mesh.num_faces} faces in {mesh.num_components} pieces, lengths in {unit}")
    print(f"error bars: {record.sigma}")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]) if len(sys.argv) > 2 else None)
