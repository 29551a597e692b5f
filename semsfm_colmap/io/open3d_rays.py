"""Rays at triangle surfaces: open3d's ray caster, behind plain functions."""

from __future__ import annotations

from typing import Any

import numpy as np

from semsfm_colmap.io.open3d_library import import_open3d
from semsfm_colmap.types import Array


def ray_scene(vertices: Array, faces: Array) -> Any:
    """A surface, (V, 3) and (F, 3), in the ray caster (open3d's `RaycastingScene`)."""
    scene = import_open3d().t.geometry.RaycastingScene()
    scene.add_triangles(as_tensor(vertices.astype(np.float32)), as_tensor(faces.astype(np.uint32)))
    return scene


def ray_tensor(origin: Array, direction: Array) -> Any:
    """Rays (..., 6) float32 for the ray caster: origins (..., 3), directions alike or one (3,)."""
    toward = np.broadcast_to(direction, origin.shape)
    both = np.concatenate([origin, toward], axis=-1, dtype=np.float32, casting="same_kind")
    return as_tensor(both)


def as_tensor(array: Array) -> Any:
    """An array, e.g. of points (N, 3) float32, for the ray caster."""
    return import_open3d().core.Tensor(array)
