"""A cloud as open3d's meshers take it."""

from __future__ import annotations

from typing import Any

import numpy as np

from semsfm_colmap.io.open3d_library import import_open3d
from semsfm_colmap.types import PointCloud


def to_open3d(cloud: PointCloud) -> Any:
    """Points, normals and colours (`open3d.geometry.PointCloud`)."""
    o3d = import_open3d()
    out = o3d.geometry.PointCloud()
    out.points = o3d.utility.Vector3dVector(np.array(cloud.points, dtype=float))
    out.normals = o3d.utility.Vector3dVector(np.array(cloud.normals, dtype=float))
    if cloud.colors is not None:
        out.colors = o3d.utility.Vector3dVector(np.asarray(cloud.colors, dtype=float) / 255.0)
    return out
