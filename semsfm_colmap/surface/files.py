"""Clouds, meshes and depth maps on disk. Every file is written aside, then renamed.

PLY is binary little-endian with float32 positions, normals, ``red green blue`` and, for clouds, a
``sigma`` attribute in world units: what open3d, MeshLab and CloudCompare read. Textured meshes go
to glTF (.glb) and Wavefront (.obj with .mtl and .png) through trimesh. Depth maps are npz files
named after their image.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, overload

import numpy as np

from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.types import Array, DepthMap, PointCloud, TriangleMesh

_PLY_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2",
    "ushort": "u2", "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
_PLY_NAMES = {"f4": "float", "u1": "uchar"}


@contextmanager
def _aside(path: Path) -> Iterator[IO[bytes]]:
    """A file that takes the place of `path` when all of it is written, and not before."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle = tempfile.NamedTemporaryFile(  # noqa: SIM115
        dir=path.parent, prefix=f".{path.name}.", suffix=".part", delete=False
    )
    try:
        with handle:
            yield handle
        os.chmod(handle.name, 0o666 & ~_umask())
        os.replace(handle.name, path)
    except BaseException:
        Path(handle.name).unlink(missing_ok=True)
        raise


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def write_ply(path: Path | str, surface: PointCloud | TriangleMesh) -> None:
    """Write a cloud or a mesh as binary PLY."""
    path = Path(path)
    if isinstance(surface, TriangleMesh):
        rows = _vertex_rows(surface.vertices, surface.vertex_normals, surface.vertex_colors, None)
        faces = np.empty(len(surface.faces), dtype=[("n", "u1"), ("v", "<i4", 3)])
        faces["n"], faces["v"] = 3, surface.faces
    else:
        rows = _vertex_rows(surface.points, surface.normals, surface.colors, surface.sigma)
        faces = None
    lines = ["ply", "format binary_little_endian 1.0", "comment semsfm_colmap"]
    lines.append(f"element vertex {len(rows)}")
    assert rows.dtype.fields is not None
    for name, (kind, *_) in rows.dtype.fields.items():
        lines.append(f"property {_PLY_NAMES[kind.str[1:]]} {name}")
    if faces is not None:
        lines += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
    with _aside(path) as file:
        file.write(("\n".join([*lines, "end_header"]) + "\n").encode("ascii"))
        file.write(rows.tobytes())
        if faces is not None:
            file.write(faces.tobytes())


def read_ply_cloud(path: Path | str) -> PointCloud:
    """Read the points of a binary little-endian PLY file, with the attributes it has."""
    rows, _ = _read_ply(Path(path))
    sigma = rows["sigma"].astype(np.float64) if "sigma" in (rows.dtype.names or ()) else None
    return PointCloud(
        points=_columns(rows, ("x", "y", "z"), np.float64, path),
        normals=_optional(rows, ("nx", "ny", "nz"), np.float64),
        colors=_optional(rows, ("red", "green", "blue"), np.uint8),
        sigma=sigma,
    )


def read_ply_mesh(path: Path | str) -> TriangleMesh:
    """Read a triangle mesh from a binary little-endian PLY file."""
    rows, faces = _read_ply(Path(path))
    if faces is None:
        raise InputError(f"{path} has no faces: it is a point cloud, not a mesh.")
    return TriangleMesh(
        vertices=_columns(rows, ("x", "y", "z"), np.float64, path),
        faces=faces,
        vertex_normals=_optional(rows, ("nx", "ny", "nz"), np.float64),
        vertex_colors=_optional(rows, ("red", "green", "blue"), np.uint8),
    )


def write_textured(mesh: TriangleMesh, folder: Path | str, stem: str = "mesh") -> tuple[Path, Path]:
    """Write a textured mesh as ``<stem>.glb`` and ``<stem>.obj`` (with .mtl and .png)."""
    if mesh.uv is None or mesh.texture is None:
        raise UsageError("mesh has no texture: call texture_mesh first.")
    import PIL.Image
    import trimesh
    from trimesh.visual.material import PBRMaterial, SimpleMaterial
    from trimesh.visual.texture import TextureVisuals

    folder = Path(folder)
    vertices, normals, uv, faces = _unshare(mesh)
    image = PIL.Image.fromarray(np.ascontiguousarray(mesh.texture))

    def with_material(material: Any) -> Any:
        return trimesh.Trimesh(
            vertices=vertices,
            faces=faces,
            vertex_normals=normals,
            visual=TextureVisuals(uv=uv, material=material),
            process=False,
            validate=False,
        )

    matte = PBRMaterial(
        baseColorTexture=image, metallicFactor=0.0, roughnessFactor=1.0, doubleSided=True
    )
    glb_path, obj_path = folder / f"{stem}.glb", folder / f"{stem}.obj"
    with _aside(glb_path) as file:
        file.write(with_material(matte).export(file_type="glb"))

    text, extra = trimesh.exchange.obj.export_obj(
        with_material(SimpleMaterial(image=image, diffuse=[255, 255, 255, 255])),
        return_texture=True,
        mtl_name=f"{stem}.mtl",
        include_normals=True,
    )
    for name, data in extra.items():
        with _aside(folder / name) as file:
            file.write(data)
    with _aside(obj_path) as file:
        file.write(text.encode("utf-8"))
    return glb_path, obj_path


def depth_map_path(folder: Path | str, image_name: str) -> Path:
    """Where the depth map of an image lies: ``<folder>/<image name>.npz``."""
    return Path(folder) / f"{image_name}.npz"


def write_depth_map(folder: Path | str, depth_map: DepthMap) -> Path:
    """Save a depth map (float32 depth, confidence in 1/255 steps)."""
    path = depth_map_path(folder, depth_map.image_name)
    arrays: dict[str, Array] = {"depth": np.asarray(depth_map.depth, dtype=np.float32)}
    if depth_map.confidence is not None:
        arrays["confidence"] = np.rint(np.clip(depth_map.confidence, 0, 1) * 255).astype(np.uint8)
    with _aside(path) as file:
        np.savez_compressed(file, allow_pickle=False, **arrays)
    return path


def read_depth_map(folder: Path | str, image_name: str) -> DepthMap:
    """Load what `write_depth_map` saved."""
    path = depth_map_path(folder, image_name)
    try:
        with np.load(path) as data:
            depth = data["depth"]
            confidence = data.get("confidence")
    except FileNotFoundError:
        raise InputError(f"{path} is missing: run the densify step first.") from None
    except (OSError, ValueError, KeyError, EOFError) as error:
        raise InputError(
            f"{path} is not a depth map ({error}): delete it, densify again."
        ) from error
    return DepthMap(
        image_name=image_name,
        depth=depth,
        confidence=None if confidence is None else confidence.astype(np.float32) / 255.0,
    )


def _vertex_rows(
    points: Array, normals: Array | None, colors: Array | None, sigma: Array | None
) -> Array:
    kinds = [(name, "<f4") for name in "xyz"]
    if normals is not None:
        kinds += [(name, "<f4") for name in ("nx", "ny", "nz")]
    if colors is not None:
        kinds += [(name, "u1") for name in ("red", "green", "blue")]
    if sigma is not None:
        kinds.append(("sigma", "<f4"))
    rows = np.empty(len(points), dtype=kinds)
    for k in range(3):
        rows["xyz"[k]] = points[:, k]
        if normals is not None:
            rows[("nx", "ny", "nz")[k]] = normals[:, k]
        if colors is not None:
            rows[("red", "green", "blue")[k]] = np.broadcast_to(colors, (len(points), 3))[:, k]
    if sigma is not None:
        rows["sigma"] = sigma
    return rows


def _read_ply(path: Path) -> tuple[Array, Array | None]:
    """Vertex rows as a structured array, faces (F, 3) or None."""
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{path} does not exist.") from None
    header, marker, body = data.partition(b"end_header\n")
    lines = header.decode("ascii", "replace").split("\n")
    if not marker or lines[0].strip() != "ply" or "binary_little_endian" not in lines[1]:
        raise InputError(f"{path} is not a binary little-endian PLY file: convert it to one.")
    counts: dict[str, int] = {}
    kinds: list[tuple[str, str]] = []
    element = ""
    for line in lines[2:]:
        word = line.split()
        if word[:1] == ["element"]:
            element = word[1]
            counts[element] = int(word[2])
        elif word[:1] == ["property"] and element == "vertex":
            kinds.append((word[2], "<" + _PLY_TYPES[word[1]]))
    rows = np.dtype(kinds)
    face = np.dtype([("n", "u1"), ("v", "<i4", 3)])
    num, num_faces = counts.get("vertex", 0), counts.get("face", 0)
    if len(body) < num * rows.itemsize + num_faces * face.itemsize:
        raise InputError(f"{path} is cut short: write it again.")
    vertices = np.frombuffer(body, dtype=rows, count=num)
    if "face" not in counts:
        return vertices, None
    faces = np.frombuffer(body, dtype=face, count=num_faces, offset=num * rows.itemsize)
    if np.any(faces["n"] != 3):
        raise InputError(f"{path} has faces that are not triangles: triangulate it.")
    return vertices, faces["v"].astype(np.int64)


def _columns(rows: Array, names: tuple[str, ...], kind: Any, path: Path | str) -> Array:
    out = _optional(rows, names, kind)
    if out is None:
        raise InputError(f"{path} has no properties {' '.join(names)}.")
    return out


def _optional(rows: Array, names: tuple[str, ...], kind: Any) -> Array | None:
    if not set(names) <= set(rows.dtype.names or ()):
        return None
    return np.stack([rows[name] for name in names], axis=1).astype(kind)


def _unshare(mesh: TriangleMesh) -> tuple[Array, Array, Array, Array]:
    """One vertex for each distinct pair of vertex and texture coordinate."""
    from semsfm_colmap.surface.mesh.repair import vertex_normals

    assert mesh.uv is not None
    corner = mesh.faces.reshape(-1)
    uv = np.asarray(mesh.uv, dtype=np.float64).reshape(-1, 2)
    key = np.column_stack([corner, np.rint(uv * 2**24)]).astype(np.int64)
    _, first, inverse = np.unique(key, axis=0, return_index=True, return_inverse=True)
    normals = mesh.vertex_normals
    if normals is None:
        normals = vertex_normals(mesh.vertices, mesh.faces)
    source = corner[first]
    return mesh.vertices[source], normals[source], uv[first], inverse.reshape(-1, 3)


class DepthMapFolder(Sequence[DepthMap]):
    """The depth maps of a folder as a sequence that reads each one when it is asked for."""

    def __init__(self, folder: Path | str, image_names: Sequence[str]) -> None:
        self.folder = Path(folder)
        self.image_names = tuple(image_names)

    def __len__(self) -> int:
        return len(self.image_names)

    @overload
    def __getitem__(self, index: int) -> DepthMap: ...

    @overload
    def __getitem__(self, index: slice) -> DepthMapFolder: ...

    def __getitem__(self, index: int | slice) -> DepthMap | DepthMapFolder:
        if isinstance(index, slice):
            return DepthMapFolder(self.folder, self.image_names[index])
        return read_depth_map(self.folder, self.image_names[index])
