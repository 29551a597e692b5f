"""Depth maps with the local planes that consumers need: slopes and normals, one at a time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from semsfm_colmap.surface.files import read_depth_map
from semsfm_colmap.surface.options import SurfaceOptions
from semsfm_colmap.types import Array, Reconstruction


@dataclass(frozen=True, kw_only=True, eq=False)
class DenseView:
    """One depth map with its local planes."""

    image_idx: int
    depth: Array
    """(h, w) depth along the viewing direction, world units, nan where unknown"""
    slope: Array
    """(2, h, w) change of the depth along x and y, per px of the map"""
    normal: Array
    """(3, h, w) unit normals toward the viewer, camera frame"""
    confidence: Array | None = None
    """(h, w) 0..1"""


def dense_views(
    reconstruction: Reconstruction, folder: Path, names: Sequence[str], options: SurfaceOptions
) -> Iterator[DenseView]:
    """Depth maps with the slopes and normals of their local planes."""
    from semsfm_colmap.surface.depth_geometry import planes_and_normals

    number = {name: i for i, name in enumerate(reconstruction.image_names)}
    for name in names:
        i = number[name]
        depth_map = read_depth_map(folder, name)
        size = reconstruction.image_size_px[i]
        planes, normals = planes_and_normals(
            reconstruction.cameras, i, size, depth_map, options.slope_radius_px
        )
        yield DenseView(
            image_idx=i,
            depth=depth_map.depth,
            slope=planes[1:],
            normal=normals,
            confidence=depth_map.confidence,
        )
