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
from semsfm_colmap.types import Array, Float, Reconstruction

FILE_NAME = "points.ply"
PROPERTIES = (
    ("x", "<f8", "double"),
    ("y", "<f8", "double"),
    ("z", "<f8", "double"),
    ("red", "u1", "uchar"),
    ("green", "u1", "uchar"),
    ("blue", "u1", "uchar"),
    ("sigma_x", "<f4", "float"),
    ("sigma_y", "<f4", "float"),
    ("sigma_z", "<f4", "float"),
    ("covariance_xy", "<f4", "float"),
    ("covariance_xz", "<f4", "float"),
    ("covariance_yz", "<f4", "float"),
    ("num_observations", "<i4", "int"),
)
"""Name, type in memory, type in the header."""
OFF_DIAGONAL = (("covariance_xy", 0, 1), ("covariance_xz", 0, 2), ("covariance_yz", 1, 2))
GREY = 128


def point_rows(reconstruction: Reconstruction) -> Array:
    """(N,) structured array of `PROPERTIES`; error bars are nan where they are not known."""
    rows = np.zeros(len(reconstruction.points), dtype=[(n, t) for n, t, _ in PROPERTIES])
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
    rows = point_rows(reconstruction)
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"comment sigma and covariance in {reconstruction.world_unit}, gauge of smallest variance",
        f"element vertex {len(rows)}",
        *[f"property {kind} {name}" for name, _, kind in PROPERTIES],
        "end_header",
    ]
    path.write_bytes("\n".join([*header, ""]).encode("ascii") + rows.tobytes())


def read_points_ply(path: Path) -> Array:
    """The rows that `write_points_ply` wrote."""
    data = path.read_bytes()
    head, found, body = data.partition(b"end_header\n")
    lines = head.decode("ascii", errors="replace").splitlines()
    expected = [f"property {kind} {name}" for name, _, kind in PROPERTIES]
    dtype = np.dtype([(n, t) for n, t, _ in PROPERTIES])
    if not found or [x for x in lines if x.startswith("property")] != expected:
        raise InputError(f"{path} is not a {FILE_NAME} of this program: run `semsfm map` again")
    count = next((int(x.split()[2]) for x in lines if x.startswith("element vertex")), -1)
    if len(body) != count * dtype.itemsize:
        raise InputError(f"{path} is cut short: run `semsfm map` again")
    return np.frombuffer(body, dtype=dtype)


def covariance_of(rows: Array) -> Float:
    """(N, 3, 3) covariances, nan where they are not known."""
    C = np.empty((len(rows), 3, 3))
    for k, axis in enumerate("xyz"):
        C[:, k, k] = rows[f"sigma_{axis}"].astype(np.float64) ** 2
    for name, a, b in OFF_DIAGONAL:
        C[:, a, b] = C[:, b, a] = rows[name]
    return C
