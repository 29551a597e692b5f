"""Whether a mesh is sound, as two other libraries see it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh

from semsfm_colmap.io.open3d_library import import_open3d
from semsfm_colmap.io.ply import write_ply
from semsfm_colmap.types import TriangleMesh


def assert_sound(mesh: TriangleMesh, folder: Path, *, watertight: bool = False) -> None:
    """Written, read back and welded: edge-manifold, one outside, no face without area or twice."""
    path = folder / "sound.ply"
    write_ply(path, mesh)
    assert_sound_file(path, watertight=watertight)


def assert_sound_file(path: Path, *, watertight: bool = False) -> None:
    """The same of a file."""
    other = trimesh.load(path, process=False, force="mesh")
    other.merge_vertices(merge_tex=True, merge_norm=True)  # welds vertices in one place
    assert len(other.faces) > 0
    _, count = np.unique(np.sort(other.edges, axis=1), axis=0, return_counts=True)
    assert count.max() <= 2
    assert len(np.unique(other.edges, axis=0)) == len(other.edges)
    assert other.is_winding_consistent
    assert len(np.unique(np.sort(other.faces, axis=1), axis=0)) == len(other.faces)
    size = float(np.linalg.norm(other.extents))
    assert other.nondegenerate_faces(height=1e-9 * size).all()
    assert np.all(other.area_faces > 0)
    assert other.is_watertight or not watertight

    o3d = import_open3d()
    third = o3d.io.read_triangle_mesh(str(path))
    assert third.is_edge_manifold(allow_boundary_edges=not watertight)
    assert third.is_vertex_manifold()
    assert third.is_orientable()
    num = len(third.triangles)
    third.remove_duplicated_triangles()
    third.remove_degenerate_triangles()
    assert len(third.triangles) == num
