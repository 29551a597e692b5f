"""What of the brightness belongs to the surface and not to the view.

Cavities that hold electrons back, thin parts that they leave on both sides, ridges that they leave
more easily than grooves.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from semsfm_colmap.io.open3d_rays import ray_tensor
from semsfm_colmap.synthetic.noise import scattered_directions
from semsfm_colmap.synthetic.scenes.base import Specimen
from semsfm_colmap.types import Array, Float

NUM_ESCAPE_RAYS = 16
"""Directions tried from each vertex; with smoothing over neighbours it is enough to look smooth."""
ESCAPE_REACH = 0.6
"""How far, in scene units, a wall takes up electrons."""


def openness(specimen: Specimen, normals: Float, scene: Any, rng: np.random.Generator) -> Float:
    """Share of secondary electrons that escape from each vertex: (V,) in 0..1, 1 in the open.

    They leave with a cosine distribution about the normal; directions so distributed are the
    points of a unit sphere put on the tip of the normal. Each ray stands for one of them.
    """
    V = len(specimen.vertices)
    lift = 2e-3
    free = np.zeros(V)
    start = specimen.vertices + lift * normals
    for ball in scattered_directions(NUM_ESCAPE_RAYS, rng, jitter=0.0):
        # A random turn about z per vertex would cost more than the smoothing afterwards.
        direction = normals + 0.999 * ball
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        hit = scene.test_occlusions(ray_tensor(start, direction), 0.0, ESCAPE_REACH)
        free += ~hit.numpy()
    return smoothed(free / NUM_ESCAPE_RAYS, specimen.faces)


def thickness(specimen: Specimen, normals: Float, scene: Any) -> Float:
    """Length of the way through the body from each vertex against its normal: (V,) scene units.

    Infinite where the way does not leave the body through its own surface.
    """
    lift = 2e-4
    start = specimen.vertices - lift * normals
    hit = scene.cast_rays(ray_tensor(start, -normals))
    leaving = np.sum(hit["primitive_normals"].numpy() * -normals, axis=1) > 0
    return np.where(leaving, hit["t_hit"].numpy().astype(np.float64), np.inf)


def convexity(specimen: Specimen, normals: Float, radius: float) -> Float:
    """How far each vertex stands out of its neighbourhood, in units of `radius`: (V,).

    ``(x - mean) . n / radius`` where the mean is that of a Gaussian of standard deviation `radius`
    on the surface: positive on ridges and tips, negative in grooves, ``radius / r`` on a ball of
    radius r >> radius. Each averaging over the neighbours along the edges, of mean square length
    e^2, adds e^2 / 2 to the variance along either tangent.

    Parameters
    ----------
    specimen : the surface
    normals : (V, 3) of its vertices
    radius : of the neighbourhood, scene units

    """
    from scipy.sparse import csr_matrix

    faces, V = specimen.faces, len(specimen.vertices)
    start = faces.reshape(-1)
    end = faces[:, [1, 2, 0]].reshape(-1)
    ones = np.ones(2 * len(start), dtype=np.float32)
    both = np.concatenate([start, end]), np.concatenate([end, start])
    neighbours = csr_matrix((ones, both), shape=(V, V))
    count = np.asarray(neighbours.sum(axis=1)).reshape(-1, 1)
    edge = specimen.vertices[end] - specimen.vertices[start]
    mean_square = float(np.mean(np.sum(edge * edge, axis=1)))
    mean = specimen.vertices.astype(np.float32)
    for _ in range(max(1, round(2.0 * radius**2 / mean_square))):
        mean = np.where(count > 0, (neighbours @ mean) / np.maximum(count, 1.0), mean)
    return np.asarray(np.sum((specimen.vertices - mean) * normals, axis=1) / radius)


def smoothed(values: Float, faces: Array) -> Float:
    """Mean over the triangles around each vertex, once: (V,) -> (V,)."""
    per_face = values[faces].mean(axis=1)
    total, count = np.zeros(len(values)), np.zeros(len(values))
    for k in range(3):
        total += np.bincount(faces[:, k], weights=per_face, minlength=len(values))
        count += np.bincount(faces[:, k], minlength=len(values))
    return np.where(count > 0, total / np.maximum(count, 1), values)
