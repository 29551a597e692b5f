"""The surface from depth maps and the points of a reconstruction: which cloud, and its mesh.

A few images at small angles give depth maps that agree on little; the points of the reconstruction
are then the better cloud. `fuse_depth_maps` measures what share of them the fused cloud covers and
decides, and its message says what happened and what would help.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from semsfm_colmap.errors import InputError
from semsfm_colmap.geometry.normals import sampling_distance
from semsfm_colmap.records import MeshRecord
from semsfm_colmap.surface.depth_view import DepthView
from semsfm_colmap.surface.fusion.cloud import sparse_cloud
from semsfm_colmap.surface.fusion.fuse import fuse
from semsfm_colmap.surface.mesh.crossings import crossing_faces, crossing_sentence
from semsfm_colmap.surface.mesh.from_cloud import mesh_cloud
from semsfm_colmap.surface.mesh.halfedges import component_labels, num_boundary_edges
from semsfm_colmap.surface.mesh.measure import measure
from semsfm_colmap.surface.mesh.vertex_sigma import with_vertex_sigma
from semsfm_colmap.surface.options import SurfaceOptions
from semsfm_colmap.types import (
    DepthMap,
    ParallelMap,
    PointCloud,
    Reconstruction,
    Solution,
    TriangleMesh,
)

Progress = Callable[[int, int], None]
"""Called with the number done and the total."""

_MIN_COVERAGE = 0.4
"""With less of the sparse points near the fused cloud, the sparse cloud is the better one."""
_GOOD_COVERAGE = 0.8
"""With less, the message says that the surface has gaps."""
_COVERED_WITHIN = 4.0
"""A sparse point is covered by fused points within this many of their spacings."""


def fuse_depth_maps(
    depth_maps: Sequence[DepthMap],
    reconstruction: Reconstruction,
    image_path: Path | str,
    options: SurfaceOptions,
    *,
    progress: Progress | None = None,
    parallel_map: ParallelMap = map,
) -> Solution[PointCloud]:
    """The cloud to mesh: the fused one, or the sparse one where the depth maps give too little.

    ``status`` is "ok", "gaps" (fused, but large parts are missing) or "sparse"; ``message`` says
    what to try; ``diagnostics["coverage"]`` is the share of sparse points that the fused cloud
    covers.
    """
    sparse = sparse_cloud(reconstruction, options)
    fused = fuse(
        depth_maps,
        reconstruction,
        image_path,
        options,
        progress=progress,
        parallel_map=parallel_map,
    )
    share = coverage(fused, sparse)
    diagnostics = {"coverage": share, "num_fused": len(fused.points)}
    if share < _MIN_COVERAGE:
        return Solution(
            value=sparse,
            status="sparse",
            message=(
                f"The depth maps agree on {len(fused.points)} points, which cover {share:.0%} of "
                f"the {len(sparse.points)} reconstructed ones: the surface is made from the "
                "reconstructed points. More images at steps of 3 to 5 degrees would help."
            ),
            diagnostics=diagnostics,
        )
    if share < _GOOD_COVERAGE:
        return Solution(
            value=fused,
            status="gaps",
            message=(
                f"The depth maps cover {share:.0%} of the reconstructed points: the surface has "
                "gaps where too few images see it or it has too little texture."
            ),
            diagnostics=diagnostics,
        )
    return Solution(value=fused, diagnostics=diagnostics)


def coverage(fused: PointCloud, sparse: PointCloud) -> float:
    """Share of the sparse points that lie near the fused cloud, 0 to 1."""
    from scipy.spatial import cKDTree

    if len(fused.points) <= 8 or len(sparse.points) == 0:
        return 0.0
    distance, _ = cKDTree(fused.points).query(sparse.points, workers=-1)
    return float(np.mean(distance <= _COVERED_WITHIN * sampling_distance(fused.points)))


def mesh(
    cloud: PointCloud, options: SurfaceOptions, views: Sequence[DepthView] = ()
) -> Solution[TriangleMesh]:
    """Mesh a cloud; a cloud that gives no surface is a failed solution, not an error.

    Vertices have the error bars of the cloud, if it has any. ``diagnostics`` counts vertices,
    faces, connected pieces and boundary edges.
    """
    try:
        surface = with_vertex_sigma(mesh_cloud(cloud, options, views), cloud)
    except InputError as error:
        return Solution(value=None, status="no surface", message=str(error))
    return Solution(
        value=surface,
        diagnostics={
            "num_vertices": len(surface.vertices),
            "num_faces": len(surface.faces),
            "num_components": int(component_labels(surface.faces).max()) + 1,
            "num_boundary_edges": num_boundary_edges(surface.faces),
        },
    )


def mesh_record(surface: TriangleMesh, method: str, notes: tuple[str, ...] = ()) -> MeshRecord:
    """What is noted of a mesh: its size, its soundness, area, volume and those of its hull."""
    size = measure(surface)
    extent = surface.vertices.max(axis=0) - surface.vertices.min(axis=0)
    num_boundary = num_boundary_edges(surface.faces)
    return MeshRecord(
        num_vertices=len(surface.vertices),
        num_faces=len(surface.faces),
        extent=tuple(extent.tolist()),
        method=method,
        num_components=int(component_labels(surface.faces).max()) + 1,
        num_boundary_edges=num_boundary,
        num_crossing_faces=None if num_boundary else len(crossing_faces(surface)),
        area=size.area,
        volume=size.volume,
        hull_area=size.hull_area,
        hull_volume=size.hull_volume,
        notes=notes,
    )


def mesh_lines(record: MeshRecord, unit: str = "") -> list[str]:
    """What is said of a mesh when it is done.

    Parameters
    ----------
    unit : of the world, empty where nothing is known of it

    """
    space = f" {unit}" if unit else ""
    closed = (
        "closed" if record.num_boundary_edges == 0 else f"{record.num_boundary_edges} open edges"
    )
    pieces = "1 piece" if record.num_components == 1 else f"{record.num_components} pieces"
    lines = [
        f"mesh: {record.num_vertices} vertices, {record.num_faces} faces, {pieces}, {closed} "
        f"({record.method})"
    ]
    sizes = [f"area {record.area:.4g}{space and space + '^2'}"]
    if record.volume is not None:
        sizes.append(f"volume {record.volume:.4g}{space and space + '^3'}")
    if record.hull_volume is not None:
        sizes.append(
            f"convex hull: volume {record.hull_volume:.4g}{space and space + '^3'}, "
            f"area {record.hull_area:.4g}{space and space + '^2'}"
        )
    lines.append(", ".join(sizes))
    if record.num_crossing_faces:
        lines.append(crossing_sentence(record.num_crossing_faces))
    return lines
