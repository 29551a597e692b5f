"""Depths as they would be without the drag of shading.

What is seen of a surface point with the outward unit normal n lies displaced by
``c n_c (n_x, n_y)``, ``n_c = -n_z`` (`refinement/drag.py`). The mapping has taken that out of the
observations; the images still have it. Let phi be the angle between normal and viewer. A depth map
compares a view at phi with views at phi + d; to first order in d the displacement
``c sin(phi) cos(phi)`` is that of a point that is shifted by h along the normal and by g along the
slope,

    h cos(phi) - g sin(phi) = c cos(2 phi),    h sin(phi) + g cos(phi) = c sin(phi) cos(phi),

so that ``h = c cos(phi)^3``: frontal surface stands out by c, steep surface is right. Along the ray
that is ``h / cos(phi)``, and a depth becomes

    z <- z + c n_z^2 / s,    s px per world unit.

Only a positive c is taken out: patterns that slide uphill are no shading, and on rendered fields
whose coefficient is negative the surface stands out all the same.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from semsfm_colmap.surface.depth_geometry import planes_and_normals
from semsfm_colmap.types import DepthMap, Reconstruction


def depth_without_drag(
    depth_map: DepthMap, reconstruction: Reconstruction, image_idx: int, radius_px: int
) -> DepthMap:
    """A depth map moved inward by what the drag has pulled it out.

    Parameters
    ----------
    reconstruction : its ``drag_px`` is the coefficient
    image_idx : the image of the map
    radius_px : reach of the planes that the normals are taken from

    """
    drag_px = reconstruction.drag_px
    if drag_px is None or drag_px <= 0.0:
        return depth_map
    cameras = reconstruction.cameras
    _, normals = planes_and_normals(
        cameras, image_idx, reconstruction.image_size_px[image_idx], depth_map, radius_px
    )
    shift = np.float32(drag_px / cameras.scale_px_per_unit[image_idx])
    return replace(depth_map, depth=depth_map.depth + shift * normals[2] ** 2)
