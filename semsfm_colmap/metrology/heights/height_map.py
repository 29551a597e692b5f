"""Heights of a surface over a plane, on a regular grid: what areal parameters are computed from.

The cell in row r and column c lies at ``origin + c dx e_x + r dy e_y + z[r, c] e_z`` of the world,
(e_x, e_y, e_z) right-handed as in ISO 25178, e_z toward the viewer. Seen along -e_z with e_x to the
right, rows go up: pictures have row 0 at the bottom. Cells that nobody has measured are nan.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.geometry.losses import HUBER_TUNING, MAD_TO_SIGMA, weight
from semsfm_colmap.geometry.mesh_normals import face_normals
from semsfm_colmap.types import Bool, Float, Int, TriangleMesh, _Frozen

MAX_OVERHANG = 0.25
"""Share of the cells with more than one surface above one another from which the topmost one is no
longer the surface: nodules upon nodules have up to 0.1, a closed body has 1."""
SAME_HEIGHT = 1e-3
"""Crossings closer together than this share of a cell are one: triangles share their edges."""
MIN_CELLS = 16
"""Least number of measured cells along either side of a height map."""
MAX_CELLS = 50_000_000
MIN_COSINE = 0.1
"""Least cosine of a slope by which an error along the normal is divided: beyond, 84 degrees, a
height says nothing of the place of a wall."""
NUM_REWEIGHTINGS = 20


@dataclass(frozen=True, kw_only=True, eq=False)
class HeightMap(_Frozen):
    """Heights on a regular grid, holes kept as holes."""

    z: Float
    """(rows, columns) heights, nan in holes"""
    spacing: tuple[float, float]
    """distance of columns (dx) and of rows (dy)"""
    unit: Literal["um", "px"]
    """of heights, spacing, sigma and origin"""
    sigma: Float | None = None
    """(rows, columns) standard deviation of each height, nan in holes"""
    origin: Float | None = None
    """(3,) world place of row 0, column 0 at height 0; None: not known"""
    axes: Float | None = None
    """(3, 3) rows e_x, e_y, e_z in the world; None: not known"""
    overhang: Bool | None = None
    """(rows, columns) where the vertical line meets the surface more than once"""

    @property
    def measured(self) -> Bool:
        """(rows, columns) cells with a height."""
        return np.asarray(np.isfinite(self.z))

    @property
    def hole_share(self) -> float:
        """Share of the cells without a height."""
        return float(1.0 - self.measured.mean())

    @property
    def overhang_share(self) -> float:
        """Share of the measured cells that are the topmost of several."""
        if self.overhang is None:
            return 0.0
        return float(self.overhang.sum() / max(int(self.measured.sum()), 1))

    @property
    def size(self) -> tuple[float, float]:
        """Lengths along x and y."""
        rows, columns = self.z.shape
        return columns * self.spacing[0], rows * self.spacing[1]

    def with_heights(self, z: Float) -> HeightMap:
        """The same map with other heights; sigma is kept where there is one."""
        sigma = None if self.sigma is None else np.where(np.isfinite(z), self.sigma, np.nan)
        return replace(self, z=z, sigma=sigma)

    def points(self) -> Float:
        """(N, 3) world places of the measured cells; those of the map where no world is known."""
        row, column = np.nonzero(self.measured)
        flat = [column * self.spacing[0], row * self.spacing[1], self.z[row, column]]
        local = np.stack(flat, axis=1)
        if self.axes is None or self.origin is None:
            return local
        return np.asarray(self.origin + local @ self.axes)


def height_map_of_mesh(
    mesh: TriangleMesh,
    unit: Literal["um", "px"],
    *,
    axis: Float | None = None,
    right: Float | None = None,
    spacing: float | None = None,
) -> HeightMap:
    """Drop vertical lines on a surface: the topmost crossing at every node of a grid.

    An error sigma along the normal is one of ``sigma / cos(slope)`` along the vertical.

    Parameters
    ----------
    mesh : open surface, faces counter-clockwise from outside; faces that close a hole
        (`face_filled`) are holes
    unit : of its vertices
    axis : (3,) direction of the heights, outward; default: `reference_normal`
    right : (3,) direction that x of the map is nearest to; default: the world's x
    spacing : of the grid; default: mean distance of the vertices

    Raises
    ------
    InputError
        A closed or overhanging body, or hardly any cell.
    UsageError
        The spacing is not positive.

    """
    if spacing is not None and not (np.isfinite(spacing) and spacing > 0.0):
        raise UsageError(f"{spacing=} but cells are wider than 0: leave it out or give a length")
    faces = seen_faces(mesh)
    vertices = mesh.vertices
    used = vertices[np.unique(faces)]
    normal = face_normals(vertices, faces)
    up = reference_normal(used, normal) if axis is None else unit_vector(axis)
    axes = right_handed_axes(up, np.array([1.0, 0.0, 0.0]) if right is None else right)
    local = used @ axes.T
    step = vertex_distance(mesh, up) if spacing is None else float(spacing)
    low, extent = local.min(axis=0), np.ptp(local, axis=0)
    columns, rows = (int(n) + 1 for n in np.floor(extent[:2] / step))
    if rows * columns > MAX_CELLS:
        raise InputError(
            f"A grid of {columns} x {rows} cells of {step:.3g} {unit} is too large: give a larger "
            "--spacing."
        )
    origin = np.array([low[0], low[1], np.median(local[:, 2])]) @ axes
    found = on_grid(mesh, unit, origin, axes, (step, step), (rows, columns))
    check_overhang(found)
    return check_cells(found)


def on_grid(
    mesh: TriangleMesh,
    unit: Literal["um", "px"],
    origin: Float,
    axes: Float,
    spacing: tuple[float, float],
    shape: tuple[int, int],
) -> HeightMap:
    """The topmost heights of a surface on a grid that is given: arguments as in `HeightMap`."""
    from semsfm_colmap.metrology.heights.raster_kernels import topmost

    faces = seen_faces(mesh)
    local = (mesh.vertices - origin) @ axes.T
    normal = face_normals(mesh.vertices, faces)
    cosine = np.abs(normal @ axes[2]) / np.maximum(np.linalg.norm(normal, axis=1), 1e-300)
    corner = np.ascontiguousarray(local[faces] / [*spacing, 1.0])
    sigma = np.zeros(faces.shape) if mesh.vertex_sigma is None else mesh.vertex_sigma[faces]
    along = np.ascontiguousarray(sigma / np.maximum(cosine, MIN_COSINE)[:, None], dtype=np.float64)
    top, bottom, taken = topmost(corner, along, *shape)
    return HeightMap(
        z=top,
        spacing=spacing,
        unit=unit,
        sigma=None if mesh.vertex_sigma is None else taken,
        origin=origin,
        axes=axes,
        overhang=top - bottom > SAME_HEIGHT * max(spacing),
    )


def seen_faces(mesh: TriangleMesh) -> Int:
    """Faces that do not close a hole."""
    faces = mesh.faces if mesh.face_filled is None else mesh.faces[~mesh.face_filled]
    if len(faces) == 0:
        raise InputError("The surface has no faces that were seen: there is nothing to measure.")
    return faces


def check_overhang(found: HeightMap) -> None:
    """Refuse a map most of which is the upper one of several surfaces."""
    share = found.overhang_share
    if share > MAX_OVERHANG:
        raise InputError(
            f"{100 * share:.0f} % of the surface lies above other parts of it: a closed or "
            "overhanging body has no height map; choose a part that is seen from one side with "
            "--region x0 y0 x1 y1 (px of an original image)."
        )


def check_cells(found: HeightMap) -> HeightMap:
    """Refuse a map of holes only, or with too few cells for any parameter."""
    rows, columns = found.measured.any(axis=1).sum(), found.measured.any(axis=0).sum()
    if min(rows, columns) < MIN_CELLS:
        raise InputError(
            f"The height map has {columns} x {rows} measured cells, {MIN_CELLS} x {MIN_CELLS} are "
            "needed: take a larger region or a smaller --spacing."
        )
    return found


def vertex_distance(mesh: TriangleMesh, up: Float) -> float:
    """Mean distance of the vertices: that of a square grid with as many on the same area."""
    faces = seen_faces(mesh)
    area = 0.5 * float(np.abs(face_normals(mesh.vertices, faces) @ up).sum())
    if not area > 0.0:
        raise InputError("The surface stands upright on its own plane: it has no height map.")
    return float(np.sqrt(area / len(np.unique(faces))))


def reference_normal(points: Float, normals: Float) -> Float:
    """(3,) normal of the least-squares plane of points, on the side of the mean face normal.

    The plane minimises Huber's loss of the distances along its normal, by iteratively reweighted
    eigen-decomposition: a pit or a stray part does not tilt it.
    """
    weights = np.ones(len(points))
    up = np.zeros(3)
    for _ in range(NUM_REWEIGHTINGS):
        centre = np.average(points, axis=0, weights=weights)
        away = points - centre
        up = np.linalg.eigh((weights[:, None] * away).T @ away)[1][:, 0]
        distance = away @ up
        scale = MAD_TO_SIGMA * np.median(np.abs(distance))
        if not scale > 0.0:
            break
        weights = weight("huber", (distance / scale) ** 2, HUBER_TUNING)
    return np.asarray(-up if normals.sum(axis=0) @ up < 0 else up)


def unit_vector(direction: Float) -> Float:
    """A direction (3,) with length 1."""
    length = float(np.linalg.norm(direction))
    if not (np.isfinite(length) and length > 0.0):
        raise InputError("The height axis has no direction: give three numbers, not all 0.")
    return np.asarray(direction, dtype=np.float64) / length


def right_handed_axes(up: Float, right: Float) -> Float:
    """(3, 3) rows e_x, e_y, e_z = up, with e_x as near to `right` as can be."""
    x = right - (right @ up) * up
    if np.linalg.norm(x) < 1e-6:
        # the wanted direction is that of the heights: any other will do
        other = np.eye(3)[np.argmin(np.abs(up))]
        x = other - (other @ up) * up
    x = x / np.linalg.norm(x)
    return np.stack([x, np.cross(up, x), up])
