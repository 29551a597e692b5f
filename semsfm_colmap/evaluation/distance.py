"""Distances of points to a triangle surface, with a sign that open surfaces have too."""

from __future__ import annotations

import numpy as np

from semsfm_colmap.geometry.mesh_normals import angle_weighted_normals, face_normals
from semsfm_colmap.io.open3d_rays import as_tensor, ray_scene, ray_tensor
from semsfm_colmap.types import Bool, Float, OrthographicCameras, TriangleMesh

NUM_PROBES = 64
"""Rays along each axis of an image that tell the outside of a surface."""
MAX_PROBED_CAMERAS = 4
LIFT = 1e-3
"""Start of a visibility ray above its surface, relative to the size of the surface."""


class Surface:
    """A triangle surface that answers for distances and visibility.

    The sign of a distance is that of ``(p - q) . n(q)`` with q the closest point and n the
    angle-weighted vertex normals interpolated there [Baerentzen, Aanaes, IEEE TVCG 11(3), 2005]:
    on a vertex, where the normal of one triangle may mislead, that is exact, and it needs no
    inside.
    """

    def __init__(self, mesh: TriangleMesh) -> None:
        self._scene = ray_scene(mesh.vertices, mesh.faces)
        self._mesh = mesh
        self._normals = angle_weighted_normals(mesh.vertices, mesh.faces)
        self._sign = 1.0

    def orient(self, cameras: OrthographicCameras, image_size_px: tuple[int, int]) -> None:
        """Let the side that the cameras see be the outside, whatever way the faces turn."""
        facing = []
        for i in np.unique(np.linspace(0, len(cameras) - 1, MAX_PROBED_CAMERAS).astype(int)):
            u, v = ((np.arange(NUM_PROBES) + 0.5) / NUM_PROBES * n for n in image_size_px)
            grid = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
            A = cameras.projection[i]
            direction = cameras.viewing_direction[i]
            near = float((self._mesh.vertices @ direction).min()) - 1.0
            origin = (grid - cameras.translation_px[i]) @ np.linalg.pinv(A).T + near * direction
            answer = self._scene.cast_rays(ray_tensor(origin, direction))
            hit = np.isfinite(answer["t_hit"].numpy())
            facing.append(answer["primitive_normals"].numpy()[hit] @ direction < 0)
        seen = np.concatenate(facing)
        self._sign = -1.0 if seen.size and seen.mean() < 0.5 else 1.0

    def signed_distance(self, points: Float) -> Float:
        """Distance of each point to the surface, positive outside: (N, 3) -> (N,)."""
        if not len(points):
            return np.zeros(0)
        answer = self._scene.compute_closest_points(as_tensor(points.astype(np.float32)))
        away = points - answer["points"].numpy()
        corner = self._mesh.faces[answer["primitive_ids"].numpy().astype(np.int64)]
        u, v = answer["primitive_uvs"].numpy().T[:, :, None]
        n = self._normals
        normal = (1.0 - u - v) * n[corner[:, 0]] + u * n[corner[:, 1]] + v * n[corner[:, 2]]
        outside = np.where(np.sum(away * normal, axis=1) < 0, -1.0, 1.0)
        return np.asarray(self._sign * outside * np.linalg.norm(away, axis=1))

    def distance(self, points: Float) -> Float:
        """Distance of each point to the surface: (N, 3) -> (N,)."""
        return np.abs(self.signed_distance(points))

    def visible_samples(
        self,
        cameras: OrthographicCameras,
        image_size_px: tuple[int, int],
        num: int,
        min_views: int = 1,
    ) -> Float:
        """Points spread evenly over the part of the surface that so many of the cameras see.

        Parameters
        ----------
        cameras : of the images
        image_size_px : width, height
        num : points on the whole surface, of which those that are seen are returned
        min_views : cameras that must see a point

        Returns
        -------
        (K, 3), K <= num

        """
        points, normals = self.samples(num)
        seen = self.visibility(points, normals, cameras, image_size_px)
        return points[seen.sum(axis=1) >= min_views]

    def visibility(
        self,
        points: Float,
        normals: Float,
        cameras: OrthographicCameras,
        image_size_px: tuple[int, int],
    ) -> Bool:
        """Which cameras see points of the surface: inside of the image, facing it, not hidden.

        Parameters
        ----------
        points, normals : (N, 3) on the surface, and its outside there
        cameras : M
        image_size_px : width, height

        Returns
        -------
        (N, M)

        """
        lift = LIFT * float(np.ptp(self._mesh.vertices, axis=0).max())
        seen = np.zeros((len(points), len(cameras)), dtype=bool)
        for i, direction in enumerate(cameras.viewing_direction):
            xy = cameras.project(points, np.full(len(points), i))
            inside = np.all((xy >= 0) & (xy <= image_size_px), axis=1)
            candidate = np.flatnonzero(inside & (normals @ direction < 0))
            origin = points[candidate] + lift * normals[candidate]
            hidden = self._scene.test_occlusions(ray_tensor(origin, -direction)).numpy()
            seen[candidate[~hidden], i] = True
        return seen

    def openings(self, points: Float, normals: Float, directions: Float) -> Float:
        """Share of the directions, (D, 3) on the sphere, above a point that nothing hides: (N,)."""
        lift = LIFT * float(np.ptp(self._mesh.vertices, axis=0).max())
        open_, above = np.zeros(len(points)), np.zeros(len(points))
        for direction in directions:
            idx = np.flatnonzero(normals @ direction > 0)
            origin = points[idx] + lift * normals[idx]
            hidden = self._scene.test_occlusions(ray_tensor(origin, direction)).numpy()
            above[idx] += 1.0
            open_[idx[~hidden]] += 1.0
        return np.asarray(open_ / np.maximum(above, 1.0))

    def thickness(self, points: Float, normals: Float) -> Float:
        """Way from points on the surface inward to its other side; inf where it is open: (N,)."""
        lift = LIFT * float(np.ptp(self._mesh.vertices, axis=0).max())
        rays = ray_tensor(points - lift * normals, -normals)
        return np.asarray(self._scene.cast_rays(rays)["t_hit"].numpy().astype(float) + lift)

    def samples(self, num: int) -> tuple[Float, Float]:
        """Points spread evenly over the surface and the unit normals on its outside: (num, 3) each.

        The centres of faces, each as often as its area asks for.
        """
        a, b, c = (self._mesh.vertices[self._mesh.faces[:, k]] for k in range(3))
        cross = face_normals(self._mesh.vertices, self._mesh.faces)
        double_area = np.linalg.norm(cross, axis=1)
        total = np.cumsum(double_area)
        chosen = np.searchsorted(total, (np.arange(num) + 0.5) / num * total[-1])
        normal = self._sign * cross[chosen] / double_area[chosen][:, None]
        return (a[chosen] + b[chosen] + c[chosen]) / 3.0, normal
