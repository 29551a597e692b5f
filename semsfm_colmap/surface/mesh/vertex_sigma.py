"""The error bars of a cloud at the vertices of the mesh made from it.

A vertex that meshing, smoothing or the closing of a hole put between the points of the cloud is as
uncertain as they are, and by what it lies off them besides: with the K nearest points at distances
``r_k`` and ``w_k = 1 / (r_k^2 + b^2)``,

    sigma^2 = sum_k w_k sigma_k^2 / sum_k w_k + max(0, r_1 - 2 b)^2 / 4,

b the spacing of the cloud. Within two spacings of a point the last term is zero; a surface that
was closed over a gap bulges by up to half of its distance to what was seen.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from semsfm_colmap.geometry.normals import sampling_distance
from semsfm_colmap.types import Float, PointCloud, TriangleMesh

NUM_NEAREST = 6
FREE_SPACINGS = 2.0
"""Within so many spacings of a point the surface is a measured one."""
BULGE = 0.5
"""Standard deviation of a surface without points, as a share of its distance to them."""


def with_vertex_sigma(mesh: TriangleMesh, cloud: PointCloud) -> TriangleMesh:
    """The mesh with the standard deviation of each vertex along its normal, if the cloud has any.

    Parameters
    ----------
    cloud : N points with ``sigma``, what the mesh was made from

    """
    if cloud.sigma is None or len(cloud.points) == 0:
        return mesh
    return replace(mesh, vertex_sigma=sigma_at(mesh.vertices, cloud))


def sigma_at(places: Float, cloud: PointCloud) -> Float:
    """The module's sigma at places (V, 3): (V,) world units."""
    from scipy.spatial import cKDTree

    assert cloud.sigma is not None
    spacing = sampling_distance(cloud.points) if len(cloud.points) > 8 else 0.0
    k = min(NUM_NEAREST, len(cloud.points))
    found = cKDTree(cloud.points).query(places, k=np.arange(1, k + 1), workers=-1)
    distance, idx = np.asarray(found[0]), np.asarray(found[1])
    weight = 1.0 / np.maximum(distance**2 + spacing**2, 1e-300)
    variance = np.sum(weight * cloud.sigma[idx] ** 2, axis=1) / np.sum(weight, axis=1)
    beyond = np.maximum(distance[:, 0] - FREE_SPACINGS * spacing, 0.0)
    return np.asarray(np.sqrt(variance + (BULGE * beyond) ** 2))
