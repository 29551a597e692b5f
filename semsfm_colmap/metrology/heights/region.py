"""Parts and places of a surface as images show them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.geometry.mesh_normals import face_normals
from semsfm_colmap.metrology.heights.height_map import HeightMap
from semsfm_colmap.types import Float, TriangleMesh

Rectangle = tuple[float, float, float, float]


def part_in_rectangle(
    mesh: TriangleMesh, shown: Float, viewing_direction: Float, rectangle: Rectangle
) -> TriangleMesh:
    """Faces whose corners lie in a rectangle of an image and that are turned toward its viewer.

    Parameters
    ----------
    shown : (V, 2) px of the image that shows the vertices
    viewing_direction : (3,) away from the viewer
    rectangle : x0, y0, x1, y1 in the same px

    Raises
    ------
    UsageError
        The rectangle is empty.
    InputError
        It shows nothing of the surface.

    """
    x0, y0, x1, y1 = rectangle
    if not (x0 < x1 and y0 < y1):
        raise UsageError(f"region {rectangle} is empty: give x0 y0 x1 y1 with x0 < x1 and y0 < y1")
    inside = np.all((shown >= [x0, y0]) & (shown <= [x1, y1]), axis=1)
    toward = face_normals(mesh.vertices, mesh.faces) @ viewing_direction < 0
    keep = inside[mesh.faces].all(axis=1) & toward
    if not keep.any():
        raise InputError(f"region {rectangle} shows nothing of the surface: choose another one.")
    return replace(
        mesh,
        faces=mesh.faces[keep],
        face_filled=None if mesh.face_filled is None else mesh.face_filled[keep],
    )


def place_in_map(
    height_map: HeightMap, shown: Float, px_per_unit: float, xy: tuple[float, float]
) -> tuple[float, float]:
    """The place x, y of a height map that an image shows at a pixel.

    Parameters
    ----------
    shown : (K, 2) px of the image that shows the cells, in the order of `HeightMap.points`
    px_per_unit : magnification of the image
    xy : px of the same image

    Raises
    ------
    InputError
        No cell is seen within a cell's width of the pixel.

    """
    row, column = np.nonzero(height_map.measured)
    away = np.linalg.norm(shown - xy, axis=1)
    nearest = int(np.argmin(away))
    if away[nearest] > max(height_map.spacing) * px_per_unit:
        raise InputError(
            f"The height map has no cell at {xy} px of the image: choose another place."
        )
    dx, dy = height_map.spacing
    return float(column[nearest] * dx), float(row[nearest] * dy)
