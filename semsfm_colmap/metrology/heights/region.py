"""Parts and places of a surface as images show them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.geometry.mesh_normals import face_normals
from semsfm_colmap.metrology.heights.height_map import HeightMap
from semsfm_colmap.types import OrthographicCameras, TriangleMesh

Rectangle = tuple[float, float, float, float]


def part_in_rectangle(
    mesh: TriangleMesh, cameras: OrthographicCameras, image: int, rectangle: Rectangle
) -> TriangleMesh:
    """Faces whose corners lie in a rectangle of an image and that are turned toward its viewer.

    Parameters
    ----------
    rectangle : x0, y0, x1, y1 in px of the image

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
    xy = cameras.project(mesh.vertices, np.full(len(mesh.vertices), image))
    inside = np.all((xy >= [x0, y0]) & (xy <= [x1, y1]), axis=1)
    toward = face_normals(mesh.vertices, mesh.faces) @ cameras.viewing_direction[image] < 0
    keep = inside[mesh.faces].all(axis=1) & toward
    if not keep.any():
        raise InputError(f"region {rectangle} shows nothing of the surface: choose another one.")
    return replace(
        mesh,
        faces=mesh.faces[keep],
        face_filled=None if mesh.face_filled is None else mesh.face_filled[keep],
    )


def place_in_map(
    height_map: HeightMap, cameras: OrthographicCameras, image: int, xy: tuple[float, float]
) -> tuple[float, float]:
    """The place x, y of a height map that an image shows at a pixel.

    Parameters
    ----------
    xy : px of the image

    Raises
    ------
    InputError
        No cell is seen within a cell's width of the pixel.

    """
    row, column = np.nonzero(height_map.measured)
    shown = cameras.project(height_map.points(), np.full(len(row), image))
    away = np.linalg.norm(shown - xy, axis=1)
    nearest = int(np.argmin(away))
    scale = float(cameras.scale_px_per_unit[image])
    if away[nearest] > max(height_map.spacing) * scale:
        raise InputError(
            f"The height map has no cell at {xy} px of the image: choose another place."
        )
    dx, dy = height_map.spacing
    return float(column[nearest] * dx), float(row[nearest] * dy)
