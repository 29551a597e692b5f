"""The mesh as a camera of the series sees it, pixel by pixel beside the image.

Parallel rays along the viewing direction, one through the middle of each pixel, meet the nearest
face. A pixel (u, v) belongs to the ray through ``pinv(P_i) ((u, v) - t_i)`` with the 2 x 3 linear
part ``P_i`` of the projection. The shading imitates what makes relief visible in a secondary
electron image: brighter where the surface is steep, with a little light from the upper left, so
that slopes to either side differ.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from semsfm_colmap.types import Array, Float, Int, OrthographicCameras, TriangleMesh

CHUNK_PIXELS = 1_000_000
"""Rays in memory at a time."""
FLAT, STEEP, LIGHT = 0.30, 0.42, 0.24
"""Brightness of a surface that faces the viewer, what an edge adds, and the light from aside."""
TOWARD_LIGHT = np.array([-1.0, -1.0]) / np.sqrt(2.0)
"""In the image: from the upper left."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Hits:
    """What each pixel of a picture shows of a mesh."""

    face: Int
    """(H, W) number of the face; -1 beside the mesh"""
    place: Array
    """(H, W, 2) barycentric coordinates of the second and third corner"""
    cam_from_world: Float
    """(3, 3) of the camera"""


class MeshView:
    """A mesh in the ray caster, to be looked at from several cameras."""

    def __init__(self, mesh: TriangleMesh) -> None:
        from semsfm_colmap.io.open3d_rays import ray_scene

        self._scene: Any = ray_scene(mesh.vertices, mesh.faces)
        self._mesh = mesh
        self._normals = _smooth_normals(mesh)
        self._centre = mesh.vertices.mean(axis=0)
        self._radius = float(np.max(np.linalg.norm(mesh.vertices - self._centre, axis=1)))

    def hits(
        self, cameras: OrthographicCameras, i: int, size_px: tuple[int, int], width_px: int
    ) -> Hits:
        """The face that each pixel of a picture shows, and where on it.

        Parameters
        ----------
        i : which of the cameras
        size_px : width and height of its image
        width_px : of the picture

        """
        from semsfm_colmap.io.open3d_rays import ray_tensor

        width = min(width_px, size_px[0])
        height = max(1, round(size_px[1] * width / size_px[0]))
        u = (np.arange(width) + 0.5) * size_px[0] / width
        v = (np.arange(height) + 0.5) * size_px[1] / height
        P, t = cameras.projection[i], cameras.translation_px[i]
        toward = cameras.viewing_direction[i]
        back = np.linalg.pinv(P)
        # in front of everything, whatever the depth of the world's origin
        start = (self._centre @ toward - 2.0 * self._radius) * toward
        face = np.empty((height, width), dtype=np.int64)
        place = np.empty((height, width, 2), dtype=np.float32)
        rows = max(1, CHUNK_PIXELS // width)
        for first in range(0, height, rows):
            some = slice(first, min(first + rows, height))
            uv = np.stack(np.meshgrid(u, v[some]), axis=-1)
            origin = (uv - t) @ back.T + start
            seen = self._scene.cast_rays(ray_tensor(origin, toward))
            number = seen["primitive_ids"].numpy().astype(np.int64)
            face[some] = np.where(number < len(self._mesh.faces), number, -1)
            place[some] = seen["primitive_uvs"].numpy()
        return Hits(face=face, place=place, cam_from_world=cameras.cam_from_world[i])

    def _at(self, corner_values: Array, face: Array, place: Array) -> Float:
        """(P, D) a quantity of the vertices at places on faces."""
        corners = corner_values[self._mesh.faces[face]]
        b, c = place[:, :1], place[:, 1:]
        return np.asarray((1.0 - b - c) * corners[:, 0] + b * corners[:, 1] + c * corners[:, 2])

    def shaded(self, hits: Hits) -> Array:
        """(H, W, 4) uint8: the relief in grey, transparent beside the mesh."""
        seen = hits.face >= 0
        normal = self._at(self._normals, hits.face[seen], hits.place[seen]) @ hits.cam_from_world.T
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
        # a surface that is met from behind is shown as if from the front
        normal *= np.where(normal[:, 2:] > 0.0, -1.0, 1.0)
        light = FLAT + STEEP * (1.0 + normal[:, 2]) ** 1.5 + LIGHT * (normal[:, :2] @ TOWARD_LIGHT)
        picture = np.zeros((*hits.face.shape, 4), dtype=np.uint8)
        picture[seen, :3] = np.clip(255.0 * light, 0.0, 255.0)[:, None].astype(np.uint8)
        picture[seen, 3] = 255
        return picture

    def textured(self, hits: Hits) -> Array | None:
        """(H, W, 4) uint8 in the mesh's own colours; None where it has none."""
        from semsfm_colmap.report.thinning import vertex_colors

        colors = vertex_colors(self._mesh)
        if colors is None:
            return None
        seen = hits.face >= 0
        picture = np.zeros((*hits.face.shape, 4), dtype=np.uint8)
        color = self._at(colors, hits.face[seen], hits.place[seen])
        picture[seen, :3] = np.rint(color).astype(np.uint8)
        picture[seen, 3] = 255
        return picture


def _smooth_normals(mesh: TriangleMesh) -> Float:
    """(V, 3) normals of the vertices, not of unit length: those of the mesh, or the faces' sums."""
    if mesh.vertex_normals is not None:
        return mesh.vertex_normals
    from semsfm_colmap.geometry.mesh_normals import vertex_normals

    return vertex_normals(mesh.vertices, mesh.faces)
