"""PLY files: vertices with named properties, and triangles; clouds and meshes as such.

Binary little-endian. Clouds and meshes have float32 positions, normals, ``red green blue`` and,
where errors are known, ``sigma`` in world units: what open3d, MeshLab and CloudCompare read. Faces
that close a hole have ``filled`` 1. Far from the origin, as in geographic coordinates, positions
are float64.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from semsfm_colmap.errors import InputError
from semsfm_colmap.io.atomic import file_aside
from semsfm_colmap.types import Array, Bool, Int, PointCloud, TriangleMesh

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2",
    "ushort": "u2", "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
FAR = 30.0
"""Distance from the origin, in extents of the cloud, beyond which positions are float64: float32
holds 6e-8 of the distance, 2e-6 of the extent."""
_NAMES = {"u1": "uchar", "i4": "int", "f4": "float", "f8": "double"}
_FACE = (("n", "u1"), ("v", "<i4", 3))
_POSITION, _NORMAL, _COLOR = ("x", "y", "z"), ("nx", "ny", "nz"), ("red", "green", "blue")


@dataclass(frozen=True, kw_only=True, eq=False)
class PlyFile:
    """What a PLY file holds."""

    vertices: Array
    """(V,) structured: one field a property"""
    faces: Int | None
    """(F, 3); None when the file speaks of none"""
    face_properties: Array | None = None
    """(F,) structured: one field a property of the faces beside their vertices"""


def write_ply_file(
    path: Path,
    vertices: Array,
    faces: Array | None = None,
    *,
    comment: str,
    face_properties: Array | None = None,
) -> None:
    """Write vertices, a structured array (V,), and triangles (F, 3) with structured properties."""
    lines = ["ply", "format binary_little_endian 1.0", f"comment {comment}"]
    lines.append(f"element vertex {len(vertices)}")
    lines += [f"property {_NAMES[kind[1:]]} {name}" for name, kind in _kinds(vertices)]
    extra = _kinds(face_properties)
    rows = np.empty(0 if faces is None else len(faces), dtype=np.dtype([*_FACE, *extra]))
    if faces is not None:
        rows["n"], rows["v"] = 3, faces
        lines += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
        for name, kind in extra:
            assert face_properties is not None
            rows[name] = face_properties[name]
            lines.append(f"property {_NAMES[kind[1:]]} {name}")
    with file_aside(path) as aside, aside.open("wb") as file:
        file.write(("\n".join([*lines, "end_header"]) + "\n").encode("ascii"))
        file.write(vertices.tobytes())
        file.write(rows.tobytes())


def _kinds(rows: Array | None) -> list[tuple[str, str]]:
    """Names and types of the fields of a structured array."""
    fields = None if rows is None else rows.dtype.fields
    return [] if fields is None else [(name, kind.str) for name, (kind, *_) in fields.items()]


def read_ply_file(path: Path) -> PlyFile:
    """Read vertices and triangles.

    Raises
    ------
    InputError
        When the file is not there, of another kind, cut short, or its faces are no triangles.

    """
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{path} does not exist.") from None
    header, marker, body = data.partition(b"end_header\n")
    lines = header.decode("ascii", "replace").split("\n")
    if not marker or lines[0].strip() != "ply" or "binary_little_endian" not in lines[1]:
        raise InputError(f"{path} is not a binary little-endian PLY file: convert it to one.")
    try:
        counts, rows, face_rows = _elements(lines[2:])
    except (ValueError, KeyError, IndexError) as error:
        raise InputError(
            f"{path} has a PLY header that is none ({error}): write it again."
        ) from error
    num, num_faces = counts.get("vertex", 0), counts.get("face", 0)
    if len(body) < num * rows.itemsize + num_faces * face_rows.itemsize:
        raise InputError(f"{path} is cut short: write it again.")
    vertices = np.frombuffer(body, dtype=rows, count=num)
    if "face" not in counts:
        return PlyFile(vertices=vertices, faces=None)
    faces = np.frombuffer(body, dtype=face_rows, count=num_faces, offset=num * rows.itemsize)
    if np.any(faces["n"] != 3):
        raise InputError(f"{path} has faces that are not triangles: triangulate it.")
    if np.any((faces["v"] < 0) | (faces["v"] >= num)):
        raise InputError(f"{path} has faces with vertices that are not there: write it again.")
    names = [name for name in face_rows.names or () if name not in ("n", "v")]
    return PlyFile(
        vertices=vertices,
        faces=faces["v"].astype(np.int64),
        face_properties=faces[names] if names else None,
    )


def _elements(
    lines: Sequence[str],
) -> tuple[dict[str, int], np.dtype[Any], np.dtype[Any]]:
    """How many of each element there are, and the rows of vertices and faces."""
    counts: dict[str, int] = {}
    kinds: list[tuple[str, str]] = []
    face_kinds: list[tuple[str, str]] = []
    element = ""
    for line in lines:
        word = line.split()
        if word[:1] == ["element"]:
            element = word[1]
            counts[element] = int(word[2])
            if counts[element] < 0:
                raise ValueError(line.strip())
        elif word[:1] == ["property"] and element == "vertex":
            kinds.append((word[2], "<" + _TYPES[word[1]]))
        elif word[:1] == ["property"] and element == "face" and word[1] != "list":
            face_kinds.append((word[2], "<" + _TYPES[word[1]]))
    if counts.get("vertex") and not kinds:
        raise ValueError("vertices without properties")
    return counts, np.dtype(kinds), np.dtype([*_FACE, *face_kinds])


def write_ply(path: Path | str, surface: PointCloud | TriangleMesh) -> None:
    """Write a cloud or a mesh."""
    marks = None
    if isinstance(surface, TriangleMesh):
        rows = _vertex_rows(
            surface.vertices, surface.vertex_normals, surface.vertex_colors, surface.vertex_sigma
        )
        faces = surface.faces
        if surface.face_filled is not None:
            marks = np.zeros(len(faces), dtype=[("filled", "u1")])
            marks["filled"] = surface.face_filled
    else:
        rows = _vertex_rows(surface.points, surface.normals, surface.colors, surface.sigma)
        faces = None
    write_ply_file(Path(path), rows, faces, comment="semsfm_colmap", face_properties=marks)


def read_ply_cloud(path: Path | str) -> PointCloud:
    """Read the points of a file, with the attributes it has."""
    rows = read_ply_file(Path(path)).vertices
    return PointCloud(
        points=_columns(rows, _POSITION, np.float64, path),
        normals=_optional(rows, _NORMAL, np.float64),
        colors=_optional(rows, _COLOR, np.uint8),
        sigma=_sigma(rows),
    )


def read_ply_mesh(path: Path | str) -> TriangleMesh:
    """Read a triangle mesh, with the attributes it has."""
    file = read_ply_file(Path(path))
    if file.faces is None:
        raise InputError(f"{path} has no faces: it is a point cloud, not a mesh.")
    return TriangleMesh(
        vertices=_columns(file.vertices, _POSITION, np.float64, path),
        faces=file.faces,
        vertex_normals=_optional(file.vertices, _NORMAL, np.float64),
        vertex_colors=_optional(file.vertices, _COLOR, np.uint8),
        vertex_sigma=_sigma(file.vertices),
        face_filled=_filled(file),
    )


def position_type(points: Array) -> np.dtype[Any]:
    """float32, or float64 for a cloud so far from the origin that float32 would blur it."""
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) == 0:
        return np.dtype("<f4")
    far, extent = np.abs(points).max(), np.ptp(points, axis=0).max()
    return np.dtype("<f8" if far > FAR * max(float(extent), 1e-300) else "<f4")


def _filled(file: PlyFile) -> Bool | None:
    marks = file.face_properties
    if marks is None or "filled" not in (marks.dtype.names or ()):
        return None
    return np.asarray(marks["filled"] > 0)


def _vertex_rows(
    points: Array, normals: Array | None, colors: Array | None, sigma: Array | None
) -> Array:
    kind = position_type(points)
    columns: list[tuple[Sequence[str], str, Array]] = [(_POSITION, kind.str, points)]
    if normals is not None:
        columns.append((_NORMAL, "<f4", normals))
    if colors is not None:
        columns.append((_COLOR, "u1", np.broadcast_to(colors, (len(points), 3))))
    if sigma is not None:
        columns.append((("sigma",), "<f4", sigma[:, None]))
    kinds = [(name, kind) for names, kind, _ in columns for name in names]
    rows = np.empty(len(points), dtype=kinds)
    for names, _, values in columns:
        for k, name in enumerate(names):
            rows[name] = values[:, k]
    return rows


def _sigma(rows: Array) -> Array | None:
    return rows["sigma"].astype(np.float64) if "sigma" in (rows.dtype.names or ()) else None


def _columns(rows: Array, names: tuple[str, ...], kind: Any, path: Path | str) -> Array:
    out = _optional(rows, names, kind)
    if out is None:
        raise InputError(f"{path} has no properties {' '.join(names)}.")
    return out


def _optional(rows: Array, names: tuple[str, ...], kind: Any) -> Array | None:
    if not set(names) <= set(rows.dtype.names or ()):
        return None
    return np.stack([rows[name] for name in names], axis=1).astype(kind)
