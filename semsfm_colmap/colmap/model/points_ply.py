"""points.ply: the sparse points with their error bars, which points3D.bin has no room for.

Binary little-endian PLY, one vertex a point in the order of COLMAP's point ids: position, colour,
standard deviations along the world's axes, the covariances between them, and how many images see
the point. Any viewer shows the positions and colours; the rest are scalar fields in CloudCompare
and attributes in MeshLab.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from semsfm_colmap.errors import InputError
from semsfm_colmap.io.ply import read_ply_file, write_ply_file
from semsfm_colmap.types import Array, Float, Reconstruction

FILE_NAME = "points.ply"
PROPERTIES = np.dtype(
    [
        ("x", "<f8"),
        ("y", "<f8"),
        ("z", "<f8"),
        ("red", "u1"),
        ("green", "u1"),
        ("blue", "u1"),
        ("sigma_x", "<f4"),
        ("sigma_y", "<f4"),
        ("sigma_z", "<f4"),
        ("covariance_xy", "<f4"),
        ("covariance_xz", "<f4"),
        ("covariance_yz", "<f4"),
        ("num_observations", "<i4"),
    ]
)
OFF_DIAGONAL = (("covariance_xy", 0, 1), ("covariance_xz", 0, 2), ("covariance_yz", 1, 2))
GREY = 128


def point_rows(reconstruction: Reconstruction) -> Array:
    """(N,) structured array of `PROPERTIES`; error bars are nan where they are not known."""
    rows = np.zeros(len(reconstruction.points), dtype=PROPERTIES)
    color = reconstruction.point_color
    covariance = reconstruction.point_covariance
    if covariance is None:
        covariance = np.full((len(rows), 3, 3), np.nan)
    for k, axis in enumerate("xyz"):
        rows[axis] = reconstruction.points[:, k]
        rows[f"sigma_{axis}"] = np.sqrt(covariance[:, k, k])
    for k, name in enumerate(("red", "green", "blue")):
        rows[name] = GREY if color is None else color[:, k]
    for name, a, b in OFF_DIAGONAL:
        rows[name] = covariance[:, a, b]
    rows["num_observations"] = reconstruction.track_length()
    return rows


def write_points_ply(reconstruction: Reconstruction, path: Path) -> None:
    """Write the points of a model."""
    unit = reconstruction.world_unit
    comment = f"sigma and covariance in {unit}, gauge of smallest variance"
    write_ply_file(path, point_rows(reconstruction), comment=comment)


def read_points_ply(path: Path) -> Array:
    """The rows that `write_points_ply` wrote."""
    rows = read_ply_file(path).vertices
    if rows.dtype != PROPERTIES:
        raise InputError(f"{path} is not a {FILE_NAME} of this program: run `semsfm map` again")
    return rows


def covariance_of(rows: Array) -> Float:
    """(N, 3, 3) covariances, nan where they are not known."""
    C = np.empty((len(rows), 3, 3))
    for k, axis in enumerate("xyz"):
        C[:, k, k] = rows[f"sigma_{axis}"].astype(np.float64) ** 2
    for name, a, b in OFF_DIAGONAL:
        C[:, a, b] = C[:, b, a] = rows[name]
    return C
