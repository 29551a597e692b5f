"""What is measured: the model, its surface, and how its images show both.

A place picked in an image is where the pixel's ray first meets the mesh. Pixels are those of the
original image; the prepared one begins at its crop, and the model is one of frames scanned at once
and without drag: with p the pixel in the prepared image, H its height, (a, b) the frame's drift, c
the drag's coefficient and n the outward normal in the camera frame,

    q = p' - c n_c (n_x, n_y),    p = p' + (a, b) (v' - H / 2) / H,    n_c = -n_z,

is where the model shows it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import PurePosixPath
from typing import Any

import numpy as np

from semsfm_colmap.errors import InputError
from semsfm_colmap.geometry.mesh_normals import vertex_normals
from semsfm_colmap.geometry.scan_drift import with_drift, without_drift
from semsfm_colmap.io.open3d_rays import ray_scene, ray_tensor
from semsfm_colmap.types import Array, Bool, Float, Int, Reconstruction, SemFrame, TriangleMesh

MIN_FACING = 0.2
"""Least cosine between a normal and the direction to the viewer for an image to see a place."""
LIFT_SHARE = 1e-3
"""Start of the rays that look for what hides a place, above it, in extents of the surface."""
OTHER_WORLD_PX = 10.0
"""A mesh whose surface lies farther than this from the points that the same image shows is of
another model: in its own they are about 1 px off."""
MAX_COMPARED = 2000
NEAREST_TRACK_PX = 5.0
"""Without a mesh, a place is the reconstructed point nearest to the pixel, no farther than this."""
FLAT_SINE = 0.05
"""Directions that see a place lie in one, to triangulation, when they spread by less than this."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Hits:
    """Where rays meet the surface first, K of them."""

    points: Float
    """(K, 3) nan where there is no surface"""
    normals: Float
    """(K, 3) outward, between those of the corners"""
    vertices: Int
    """(K,) the nearest corner; -1 where there is no surface"""
    filled: Bool
    """(K,) the surface there closes a hole: nobody saw it"""

    @property
    def found(self) -> Bool:
        """(K,) where there is surface."""
        return np.asarray(self.vertices >= 0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Specimen:
    """A model with its surface."""

    model: Reconstruction
    mesh: TriangleMesh | None
    frames: tuple[SemFrame, ...] = ()
    """Of the series, for the crops; without one, pixels are those of the model's images"""
    mask: Callable[[str], Array | None] = lambda name: None
    """The mask (H, W) of a prepared image, 0 where it is ignored"""
    labels: Int | None = None
    """(V,) of the vertices"""
    label_names: Mapping[str, int] = field(default_factory=dict)

    def image_named(self, name: str) -> int:
        """The number of an image by its name, or by that of the file it was made from.

        Raises
        ------
        InputError
            No image of the model, or several, are called so.

        """
        source = {f.name: PurePosixPath(f.source_path.replace("\\", "/")).name for f in self.frames}
        found = [
            i
            for i, own in enumerate(self.model.image_names)
            if name in (own, source.get(own), PurePosixPath(own).name)
        ]
        if name in self.model.image_names:
            found = [self.model.image_names.index(name)]
        if not found:
            if name in source or name in source.values():
                raise InputError(f"{name} is not registered in the model: pick in another image")
            raise InputError(
                f"no image is called {name}: the images are {_some(self.model.image_names)}"
            )
        if len(found) > 1:
            names = [self.model.image_names[i] for i in found]
            raise InputError(f"{name} may be any of {_some(names)}: give one of these names")
        return found[0]

    def prepared_pixel(self, image: int, xy: Float, what: str) -> Float:
        """Pixels (K, 2) of the prepared image for those of the original.

        Parameters
        ----------
        what : asked for them, for a message

        Raises
        ------
        InputError
            One lies outside of what of the image is used, or where its mask leaves it out.

        """
        name = self.model.image_names[image]
        width, height = (int(size) for size in self.model.image_size_px[image])
        x0, y0 = self.crop_origin(name)
        prepared = np.asarray(xy, dtype=np.float64) - [x0, y0]
        for (x, y), (u, v) in zip(np.atleast_2d(xy), np.atleast_2d(prepared), strict=True):
            if not (0.0 <= u < width and 0.0 <= v < height):
                raise InputError(
                    f"{what}: {name}:{x:g},{y:g} lies outside of the image, of which x {x0} to "
                    f"{x0 + width} and y {y0} to {y0 + height} are used: pick a place within"
                )
            mask = self.mask(name)
            if mask is not None and mask[int(v), int(u)] == 0:
                raise InputError(
                    f"{what}: {name}:{x:g},{y:g} is masked out: pick a place on the "
                    "specimen, or change the mask"
                )
        return prepared

    def crop_origin(self, name: str) -> tuple[int, int]:
        """Where a prepared image begins in its original, px."""
        frame = next((f for f in self.frames if f.name == name), None)
        return (0, 0) if frame is None else (frame.crop_px[0], frame.crop_px[1])

    def hits(self, image: int, pixels: Float) -> Hits:
        """Where the rays of pixels (K, 2) of a prepared image first meet the mesh."""
        q = self.undrifted(image, pixels)
        found = self._cast(image, q)
        drag = self.model.drag_px
        if drag is None or drag <= 0.0:
            return found
        # the surface that is seen there tells how far its pattern was dragged
        n = np.nan_to_num(found.normals) @ self.model.cameras.cam_from_world[image].T
        return self._cast(image, q + drag * n[:, 2:] * n[:, :2])

    def undrifted(self, image: int, pixels: Float) -> Float:
        """Pixels (K, 2) of a prepared image as one scanned at once would have them."""
        q = np.asarray(pixels, dtype=np.float64)
        drift = self.model.drift_px
        if drift is None:
            return q
        height = np.full(len(q), float(self.model.image_size_px[image, 1]))
        return without_drift(q, np.broadcast_to(drift[image], q.shape), height)

    def shown(self, image: int, points: Float, normals: Float) -> Float:
        """Pixels (K, 2) of the original image that show places (K, 3) of the surface.

        The module's formula; nothing is asked about what hides them.

        Parameters
        ----------
        normals : (K, 3) outward

        """
        cameras = self.model.cameras
        pixels = cameras.project(points, np.full(len(points), image))
        if self.model.drag_px is not None:
            n = normals @ cameras.cam_from_world[image].T
            pixels = pixels - self.model.drag_px * n[:, 2:] * n[:, :2]
        if self.model.drift_px is not None:
            height = np.full(len(points), float(self.model.image_size_px[image, 1]))
            drift = np.broadcast_to(self.model.drift_px[image], pixels.shape)
            pixels = with_drift(pixels, drift, height)
        return np.asarray(pixels + self.crop_origin(self.model.image_names[image]))

    def on_rays(self, image: int, q: Float) -> Float:
        """A place (K, 3) on the ray of each pixel that the model shows there."""
        cameras = self.model.cameras
        A = cameras.projection[image]
        return np.asarray((q - cameras.translation_px[image]) @ np.linalg.solve(A @ A.T, A))

    def _cast(self, image: int, q: Float) -> Hits:
        assert self.mesh is not None
        v = self.model.cameras.viewing_direction[image]
        start = self.on_rays(image, q)
        near = float((self.mesh.vertices @ v).min()) - self.extent
        start = start + (near - start @ v)[:, None] * v
        answer = self.scene.cast_rays(ray_tensor(start.astype(np.float32), v.astype(np.float32)))
        depth = answer["t_hit"].numpy().astype(np.float64)
        hit = np.isfinite(depth)
        points = np.full((len(q), 3), np.nan)
        normals = np.full((len(q), 3), np.nan)
        vertices = np.full(len(q), -1, dtype=np.int64)
        points[hit] = start[hit] + depth[hit, None] * v
        face = answer["primitive_ids"].numpy()[hit].astype(np.int64)
        filled = np.zeros(len(q), dtype=bool)
        if self.mesh.face_filled is not None:
            filled[hit] = self.mesh.face_filled[face]
        corner = self.mesh.faces[face]
        uv = answer["primitive_uvs"].numpy()[hit].astype(np.float64)
        share = np.column_stack([1.0 - uv.sum(axis=1), uv])
        n = np.einsum("kc,kci->ki", share, self.normals[corner])
        normals[hit] = n / np.maximum(np.linalg.norm(n, axis=1, keepdims=True), 1e-300)
        vertices[hit] = corner[np.arange(len(corner)), share.argmax(axis=1)]
        return Hits(points=points, normals=normals, vertices=vertices, filled=filled)

    def nearest_track(self, image: int, pixel: Float) -> tuple[int, Float]:
        """The reconstructed point that an image shows nearest to a pixel, and where (2,)."""
        obs = self.model.observations
        rows = np.flatnonzero((obs.image_idx == image) & self.model.inlier)
        best = rows[np.argmin(np.linalg.norm(obs.xy[rows] - pixel, axis=1))]
        return int(obs.track_idx[best]), np.asarray(obs.xy[best])

    def sees(self, points: Float, normals: Float) -> Bool:
        """(K, M) the images that see a place of the surface: facing it, and not behind another."""
        cameras, size = self.model.cameras, self.model.image_size_px
        v = np.asarray(cameras.viewing_direction)
        sees = -(normals @ v.T) >= MIN_FACING
        for i in range(len(cameras)):
            uv = cameras.project(points, np.full(len(points), i))
            sees[:, i] &= np.all((uv >= 0.0) & (uv < size[i]), axis=1)
            some = np.flatnonzero(sees[:, i])
            if self.mesh is not None and len(some):
                start = points[some] + LIFT_SHARE * self.extent * normals[some]
                rays = ray_tensor(start.astype(np.float32), (-v[i]).astype(np.float32))
                sees[some, i] = ~self.scene.test_occlusions(rays).numpy()
        return np.asarray(sees)

    def followed(self, sees: Bool) -> Float:
        """(K, M) weights of the images that places follow: 1 for those that see one.

        Places that no two images at an angle see, in a cleft or on a filling, are given to all.
        """
        v = np.asarray(self.model.cameras.viewing_direction)
        spread = np.einsum("km,mi,mj->kij", sees.astype(np.float64), v, v)
        # the second eigenvalue is the sum of squared sines to the mean direction
        alone = np.linalg.eigvalsh(spread)[:, 1] < FLAT_SINE**2
        return np.asarray(sees | alone[:, None], dtype=np.float64)

    def seen_by(self, points: Float, normals: Float) -> Float:
        """(K, M) 1 for the images that places of the surface follow, 0 for the others."""
        return self.followed(self.sees(points, normals))

    def check_one_world(self) -> None:
        """Refuse a mesh that is not of the model: mapped again, it may be turned or reversed.

        Raises
        ------
        InputError
            The surface that an image shows where its reconstructed points are lies off them.

        """
        obs = self.model.observations
        image = self.model.num_images // 2
        rows = np.flatnonzero((obs.image_idx == image) & self.model.inlier)[:MAX_COMPARED]
        if self.mesh is None or len(rows) == 0:
            return
        away = self._cast(image, obs.xy[rows]).points - self.model.points[obs.track_idx[rows]]
        off = np.linalg.norm(away[np.isfinite(away[:, 0])], axis=1) / self.px
        if len(off) == 0 or np.median(off) > OTHER_WORLD_PX:
            found = "nowhere near" if len(off) == 0 else f"{np.median(off):.0f} px (median) off"
            raise InputError(
                f"mesh/mesh.ply lies {found} the points of sparse/0: it is of another model; run "
                "`semsfm densify` and `semsfm mesh` again"
            )

    @cached_property
    def scene(self) -> Any:
        """The mesh in the ray caster."""
        assert self.mesh is not None
        return ray_scene(self.mesh.vertices, self.mesh.faces)

    @cached_property
    def normals(self) -> Float:
        """(V, 3) of the vertices, outward."""
        assert self.mesh is not None
        if self.mesh.vertex_normals is not None:
            return np.asarray(self.mesh.vertex_normals)
        return vertex_normals(self.mesh.vertices, self.mesh.faces)

    @cached_property
    def extent(self) -> float:
        """Diagonal of the box around the surface, or around the points where there is none."""
        points = self.model.points if self.mesh is None else self.mesh.vertices
        return float(np.linalg.norm(np.ptp(points, axis=0)))

    @cached_property
    def px(self) -> float:
        """World units of one px of the images at their mean magnification."""
        return 1.0 / self.model.cameras.mean_scale_px_per_unit


def visible_vertices(specimen: Specimen, image: int) -> tuple[Int, Float]:
    """Vertices that an image sees, and their pixels (K, 2) there, as the model has them."""
    assert specimen.mesh is not None
    cameras = specimen.model.cameras
    v = np.asarray(cameras.viewing_direction[image])
    facing = np.flatnonzero(-(specimen.normals @ v) > 0.0)
    points = specimen.mesh.vertices[facing]
    start = points + LIFT_SHARE * specimen.extent * specimen.normals[facing]
    rays = ray_tensor(start.astype(np.float32), (-v).astype(np.float32))
    free = ~specimen.scene.test_occlusions(rays).numpy()
    chosen = facing[free]
    return chosen, cameras.project(points[free], np.full(int(free.sum()), image))


def _some(names: tuple[str, ...] | list[str], most: int = 6) -> str:
    listed = ", ".join(names[:most])
    return listed if len(names) <= most else f"{listed} and {len(names) - most} more"
