"""Layers of the scene: arrays of what is drawn, and what it can be coloured by."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from semsfm_colmap.geometry.mesh_normals import vertex_normals
from semsfm_colmap.geometry.unshared import unshared
from semsfm_colmap.types import Array, Float, Int, PointCloud, Reconstruction, TriangleMesh


@dataclass(frozen=True, kw_only=True, eq=False)
class Layer:
    """Something that can be shown, hidden and coloured."""

    name: str
    """of its arrays, and in the page"""
    label: str
    kind: str
    """mesh or points"""
    shown: bool
    """at first"""
    arrays: Mapping[str, Array]
    """position, normal, face, uv, color"""
    values: Mapping[str, Array]
    """sigma, views, residual, label of each vertex or point"""

    def header(self) -> dict[str, Any]:
        """As the page's script reads it."""
        return {
            "name": self.name,
            "label": self.label,
            "kind": self.kind,
            "shown": self.shown,
            "values": list(self.values),
        }

    def named(self) -> dict[str, Array]:
        """All arrays, under names of their own."""
        return {f"{self.name}.{key}": v for key, v in (*self.arrays.items(), *self.values.items())}


def points_layer(rec: Reconstruction, some: Int, origin: Float, *, shown: bool) -> Layer:
    """Points of the model (N,), by their numbers."""
    arrays: dict[str, Array] = {"position": (rec.points[some] - origin).astype(np.float32)}
    if rec.point_color is not None:
        arrays["color"] = np.asarray(rec.point_color, dtype=np.uint8)[some]
    track = rec.observations.track_idx[rec.inlier]
    square = np.sum(rec.residuals()[rec.inlier] ** 2, axis=1)
    number = np.maximum(rec.track_length(), 1)
    rms = np.sqrt(np.bincount(track, square, minlength=len(rec.points)) / (2.0 * number))
    values: dict[str, Array] = {
        "views": rec.track_length()[some].astype(np.uint16),
        "residual": rms[some].astype(np.float32),
    }
    if rec.point_covariance is not None:
        largest = np.linalg.eigvalsh(rec.point_covariance[some])[:, 2]
        values = {"sigma": np.sqrt(np.maximum(largest, 0.0)).astype(np.float32), **values}
    return Layer(
        name="points", label="points", kind="points", shown=shown, arrays=arrays, values=values
    )


def cloud_layer(cloud: PointCloud, some: Int, origin: Float, *, shown: bool) -> Layer:
    """Points of the dense cloud, by their numbers."""
    arrays: dict[str, Array] = {"position": (cloud.points[some] - origin).astype(np.float32)}
    if cloud.colors is not None:
        colors = np.asarray(cloud.colors)[some].reshape(len(some), -1)
        arrays["color"] = np.broadcast_to(colors, (len(some), 3)).astype(np.uint8)
    values = {}
    if cloud.sigma is not None:
        values["sigma"] = np.asarray(cloud.sigma)[some].astype(np.float32)
    return Layer(
        name="cloud", label="dense cloud", kind="points", shown=shown, arrays=arrays, values=values
    )


def mesh_layer(
    mesh: TriangleMesh,
    origin: Float,
    *,
    name: str,
    label: str,
    shown: bool,
    values: Mapping[str, Array],
    nearest: Callable[[Float], Int],
) -> Layer:
    """A mesh, with its texture coordinates where it has a texture.

    Parameters
    ----------
    values : of the vertices of the measured mesh
    nearest : which of those lies nearest to a place

    """
    if mesh.uv is not None and mesh.texture is not None:
        positions, normals, uv, faces = unshared(mesh)
        arrays = {"uv": _unsigned(np.column_stack([uv[:, 0], 1.0 - uv[:, 1]]))}
    else:
        positions, faces, arrays = mesh.vertices, mesh.faces, {}
        own = mesh.vertex_normals
        normals = vertex_normals(positions, faces) if own is None else own
        if mesh.vertex_colors is not None:
            colors = np.asarray(mesh.vertex_colors)
            arrays["color"] = np.broadcast_to(colors, (len(colors), 3)).astype(np.uint8)
    of = nearest(positions) if values else np.zeros(0, dtype=np.int64)
    return Layer(
        name=name,
        label=label,
        kind="mesh",
        shown=shown,
        arrays={
            "position": (positions - origin).astype(np.float32),
            "normal": signed(normals, np.int8),
            "face": faces.astype(np.uint32),
            **arrays,
        },
        values={key: value[of] for key, value in values.items()},
    )


def signed(unit: Float, kind: type) -> Array:
    """Components from -1 to 1 as integers of the full range."""
    most = np.iinfo(kind).max
    return np.rint(np.clip(np.nan_to_num(unit), -1.0, 1.0) * most).astype(kind)


def _unsigned(share: Float) -> Array:
    return np.rint(np.clip(share, 0.0, 1.0) * 65535.0).astype(np.uint16)
