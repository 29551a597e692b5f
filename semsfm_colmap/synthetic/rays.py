"""The ray caster of open3d, behind three plain functions."""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np

from semsfm_colmap.errors import MissingDependencyError
from semsfm_colmap.types import Array


def open3d() -> Any:
    """The module open3d, or one sentence on why it does not load."""
    try:
        return importlib.import_module("open3d")
    except (ImportError, OSError) as error:
        raise MissingDependencyError(
            f"Rendering needs open3d, which does not load ({error}): install open3d-cpu, and on"
            " Debian or Ubuntu libusb-1.0-0, libegl1 and libgl1."
        ) from error


def ray_scene(vertices: Array, faces: Array) -> Any:
    """A surface, (V, 3) and (F, 3), in the ray caster."""
    o3d = open3d()
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        o3d.core.Tensor(vertices.astype(np.float32)), o3d.core.Tensor(faces.astype(np.uint32))
    )
    return scene


def ray_tensor(origin: Array, direction: Array) -> Any:
    """Rays of origins and directions, (N, 3) each, for the ray caster."""
    both = np.concatenate([origin, direction], axis=1, dtype=np.float32, casting="same_kind")
    return as_tensor(both)


def as_tensor(array: Array) -> Any:
    """An array, e.g. of rays (..., 6) float32, for the ray caster."""
    return open3d().core.Tensor(array)
