"""What a mesher is handed and what it gives back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from semsfm_colmap.surface.depth_view import DepthView
from semsfm_colmap.types import Array, Float, Int, PointCloud


@dataclass(frozen=True, kw_only=True, eq=False)
class MeshTask:
    """An oriented cloud, thinned and smoothed, and what is known besides."""

    cloud: PointCloud
    """N >= 20 points with unit normals toward the viewers"""
    spacing: float
    """b, the median distance to the 8th neighbour, world units"""
    views: Sequence[DepthView] = ()
    """Depth maps of the same surface, where there are any"""

    @property
    def normals(self) -> Float:
        """(N, 3) unit normals."""
        assert self.cloud.normals is not None
        return self.cloud.normals


@dataclass(frozen=True, kw_only=True, eq=False)
class RawSurface:
    """Triangles as a method gives them, before repair."""

    vertices: Float
    """(V, 3)"""
    faces: Int
    """(F, 3)"""
    colors: Array | None = None
    """(V, 3) uint8"""
    oriented: bool = True
    """Faces are counter-clockwise seen from outside; otherwise the cloud's normals decide."""
