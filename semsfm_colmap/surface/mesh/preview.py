"""Shaded pictures of meshes without a graphics card: parallel rays and Lambert's law.

The picture is what an orthographic camera sees. A key light from the upper left and a fill light
from the viewer add up, ``brightness = ambient + key max(0, n . l) + fill max(0, n . v)``. Faces
seen from inside are tinted, so that holes and flipped patches show. Used for the documentation.
"""

from __future__ import annotations

import numpy as np

from semsfm_colmap.errors import UsageError
from semsfm_colmap.geometry.mesh_normals import face_normals, vertex_normals
from semsfm_colmap.geometry.rotations import rotation_from_vector
from semsfm_colmap.io.open3d_rays import ray_scene, ray_tensor
from semsfm_colmap.types import Array, Float, TriangleMesh

_LIGHT_CAM = np.array([-0.45, -0.55, -0.70]) / np.linalg.norm([-0.45, -0.55, -0.70])
"""From the surface to the light, in the camera frame (x right, y down, z away)."""
_AMBIENT, _KEY, _FILL = 0.12, 0.55, 0.45
"""Shares of the lights; what exceeds 1 is white."""
_MARGIN = 0.05
"""Free border, as a share of the picture."""
SURFACE_GREY = (205, 205, 210)
INSIDE_COLOR = (176, 108, 84)
BACKGROUND = (255, 255, 255)


def turntable(cam_from_world: Float, angles_deg: Float, axis: Float | None = None) -> Float:
    """Views around a camera's upright image axis (or another, in its frame): (K, 3, 3)."""
    axis = np.array([0.0, 1.0, 0.0]) if axis is None else np.asarray(axis, dtype=np.float64)
    turn = np.radians(np.asarray(angles_deg, dtype=np.float64))[:, None] * axis
    return np.asarray(rotation_from_vector(turn) @ np.asarray(cam_from_world))


def render_mesh(
    mesh: TriangleMesh,
    cam_from_world: Float | None = None,
    *,
    size_px: tuple[int, int] = (640, 480),
    use_colors: bool = False,
    smooth: bool = True,
    supersampling: int = 2,
) -> Array:
    """Picture of a mesh, fitted to the frame.

    Parameters
    ----------
    mesh : with F >= 1 faces
    cam_from_world : (3, 3) view; identity when None
    size_px : width, height
    use_colors : the texture, or else the vertex colours, instead of grey
    smooth : interpolate vertex normals, otherwise one normal a face

    Returns
    -------
    (H, W, 3) uint8

    """
    if len(mesh.faces) == 0:
        raise UsageError("mesh has no faces: there is nothing to render.")
    R = np.eye(3) if cam_from_world is None else np.asarray(cam_from_world)
    vertices = mesh.vertices @ R.T
    width, height = (supersampling * s for s in size_px)
    origin, pixel = _fit(vertices, width, height)

    u, v = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    depth = np.full(u.shape, vertices[:, 2].min() - pixel)
    start = np.stack([origin[0] + u * pixel, origin[1] + v * pixel, depth], axis=-1)
    rays = ray_tensor(start, np.array([0.0, 0.0, 1.0]))
    hit = ray_scene(vertices, mesh.faces).cast_rays(rays)
    seen = np.isfinite(hit["t_hit"].numpy())
    face = hit["primitive_ids"].numpy()[seen].astype(np.int64)
    bary = hit["primitive_uvs"].numpy()[seen].astype(np.float64)
    weight = np.column_stack([1.0 - bary.sum(axis=1), bary])

    flat = face_normals(vertices, mesh.faces)[face]
    flat /= np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-300)
    inside = flat[:, 2] > 0
    normal = flat
    if smooth:
        corner = vertex_normals(vertices, mesh.faces)[mesh.faces[face]]
        normal = np.einsum("nk,nki->ni", weight, corner)
    color = np.tile(np.asarray(SURFACE_GREY, dtype=np.float64), (len(face), 1))
    if use_colors and mesh.uv is not None and mesh.texture is not None:
        color = _sample(mesh.texture, np.einsum("nk,nki->ni", weight, mesh.uv[face]))
    elif use_colors and mesh.vertex_colors is not None:
        color = np.einsum("nk,nki->ni", weight, mesh.vertex_colors[mesh.faces[face]].astype(float))
    color[inside] = INSIDE_COLOR
    normal = np.where(inside[:, None], -normal, normal)

    canvas = np.empty((height, width, 3))
    canvas[:] = BACKGROUND
    canvas[seen] = color * (1.0 if use_colors else _lambert(normal)[:, None])
    return _downsample(canvas, supersampling)


def _fit(points: Float, width: int, height: int) -> tuple[Float, float]:
    """World position of the picture's corner and the size of a pixel, so that all points fit."""
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    extent = np.maximum(high - low, 1e-12)
    room = (1.0 - 2.0 * _MARGIN) * np.array([width, height])
    pixel = float(np.max(extent / room))
    return np.asarray(0.5 * (low + high) - 0.5 * pixel * np.array([width, height])), pixel


def _sample(texture: Array, uv: Float) -> Float:
    """Bilinear texture values at coordinates with the origin at the bottom left: (n, 3)."""
    height, width = texture.shape[:2]
    x = np.clip(uv[:, 0] * width - 0.5, 0.0, width - 1.001)
    y = np.clip((1.0 - uv[:, 1]) * height - 0.5, 0.0, height - 1.001)
    ix, iy = x.astype(np.int64), y.astype(np.int64)
    fx, fy = (x - ix)[:, None], (y - iy)[:, None]
    top = (1.0 - fx) * texture[iy, ix] + fx * texture[iy, ix + 1]
    low = (1.0 - fx) * texture[iy + 1, ix] + fx * texture[iy + 1, ix + 1]
    return np.asarray((1.0 - fy) * top + fy * low)


def _lambert(normals: Float) -> Float:
    key = np.maximum(normals @ _LIGHT_CAM, 0.0)
    fill = np.maximum(-normals[:, 2], 0.0)
    return np.asarray(np.minimum(_AMBIENT + _KEY * key + _FILL * fill, 1.0))


def _downsample(canvas: Float, factor: int) -> Array:
    height, width = canvas.shape[0] // factor, canvas.shape[1] // factor
    mean = canvas.reshape(height, factor, width, factor, 3).mean(axis=(1, 3))
    return np.clip(np.rint(mean), 0, 255).astype(np.uint8)
