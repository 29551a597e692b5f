"""Textured meshes and depth maps on disk (clouds and plain meshes: `io/ply.py`).

Textured meshes go to glTF (.glb, through trimesh) and Wavefront (.obj with .mtl and .png). Depth
maps are npz files named after their image.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import overload

import numpy as np

from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.geometry.mesh_normals import vertex_normals
from semsfm_colmap.geometry.unshared import unshared
from semsfm_colmap.io.atomic import file_aside, write_bytes, write_json, write_text
from semsfm_colmap.io.npz import UNREADABLE
from semsfm_colmap.io.ply import write_ply_file
from semsfm_colmap.surface.depth_view import DepthView, LazyViews, parallel_view
from semsfm_colmap.surface.half_series import HalfDifference
from semsfm_colmap.surface.shading import Shading
from semsfm_colmap.types import Array, DepthMap, Float, Int, Reconstruction, TriangleMesh

GLTF_FROM_WORLD = np.diag([1.0, -1.0, -1.0, 1.0])
"""Half a turn about x: ours has y down and z away from the viewer, glTF y up and z toward him."""


def write_textured(mesh: TriangleMesh, folder: Path | str, stem: str = "mesh") -> tuple[Path, Path]:
    """Write a textured mesh as ``<stem>.glb`` and ``<stem>.obj`` (with .mtl and .png).

    glTF has one number for a vertex with its texture coordinate, so the mesh is parted at the seams
    of the atlas; the normals on both sides of one are the same. In the .obj positions and normals
    are shared, and texture coordinates have numbers of their own: it is the mesh in one piece.
    """
    if mesh.uv is None or mesh.texture is None:
        raise UsageError("mesh has no texture: call texture_mesh first.")
    import PIL.Image
    import trimesh
    from trimesh.visual.material import PBRMaterial, SimpleMaterial
    from trimesh.visual.texture import TextureVisuals

    folder = Path(folder)
    vertices, normals, uv, faces = unshared(mesh)
    image = PIL.Image.fromarray(np.ascontiguousarray(mesh.texture))
    matte = PBRMaterial(
        baseColorTexture=image, metallicFactor=0.0, roughnessFactor=1.0, doubleSided=True
    )
    parted = trimesh.Trimesh(
        vertices=vertices,
        faces=faces,
        vertex_normals=normals,
        visual=TextureVisuals(uv=uv, material=matte),
        process=False,
        validate=False,
    )
    glb_path, obj_path = folder / f"{stem}.glb", folder / f"{stem}.obj"
    # the vertices stay as in mesh.ply; a viewer shows them through the node that holds them
    scene = trimesh.Scene()
    scene.add_geometry(parted, transform=GLTF_FROM_WORLD)
    write_bytes(scene.export(file_type="glb"), glb_path)

    files, material = SimpleMaterial(image=image, diffuse=[255, 255, 255, 255]).to_obj()
    files[f"{stem}.mtl"] = files.pop(f"{material}.mtl")
    for name, data in files.items():
        write_bytes(data, folder / name)
    write_text(_obj_text(mesh, uv, faces, f"{stem}.mtl", material), obj_path)
    return glb_path, obj_path


def _obj_text(mesh: TriangleMesh, uv: Float, uv_faces: Int, library: str, material: str) -> str:
    """A Wavefront .obj of a mesh, with texture coordinates (T, 2) and their triangles (F, 3)."""
    normals = mesh.vertex_normals
    if normals is None:
        normals = vertex_normals(mesh.vertices, mesh.faces)
    text = io.StringIO()
    text.write(f"mtllib {library}\n")
    for row, values in (("v %.9g %.9g %.9g", mesh.vertices), ("vt %.9g %.9g", uv),
                        ("vn %.6g %.6g %.6g", normals)):  # fmt: skip
        np.savetxt(text, values, fmt=row)
    text.write(f"usemtl {material}\n")
    corners = np.stack([mesh.faces, uv_faces, mesh.faces], axis=2) + 1
    np.savetxt(text, corners.reshape(-1, 9), fmt="f" + " %d/%d/%d" * 3)
    return text.getvalue()


def read_textured(path: Path | str) -> TriangleMesh:
    """A textured mesh that `write_textured` wrote as .glb; its vertices are parted at the seams.

    Raises
    ------
    InputError
        The file is not one of these, or cut short.

    """
    import trimesh

    try:
        # without what the node says: in the frame of the model
        (read,) = trimesh.load_scene(path, file_type="glb", process=False).geometry.values()
        uv, picture = read.visual.uv, read.visual.material.baseColorTexture
        faces = np.asarray(read.faces, dtype=np.int64)
        return TriangleMesh(
            vertices=np.asarray(read.vertices, dtype=np.float64),
            faces=faces,
            vertex_normals=np.asarray(read.vertex_normals, dtype=np.float64),
            uv=np.asarray(uv, dtype=np.float64)[faces],
            texture=np.asarray(picture.convert("RGB")),
        )
    except (OSError, ValueError, KeyError, AttributeError, TypeError, IndexError) as error:
        raise InputError(f"{path} is no textured mesh ({error}): run `semsfm mesh`") from error


def write_shading(shading: Shading, image_names: Sequence[str], path: Path) -> None:
    """Write the shading of a texture as JSON; docs/files.md has the formula."""
    gain = dict(zip(image_names, shading.gain.tolist(), strict=True))
    write_json({"gradient": shading.gradient.tolist(), "gain": gain}, path)


def write_half_difference(path: Path, found: HalfDifference) -> None:
    """Write the odd frames' points with ``difference`` and ``sigma``, nan where there is no other.

    Colours go from blue, where the even frames' surface lies two sigma inside, over white to red.
    """
    cloud = found.cloud
    assert cloud.normals is not None
    kinds = [(name, "<f4") for name in ("x", "y", "z", "nx", "ny", "nz")]
    kinds += [(name, "u1") for name in ("red", "green", "blue")]
    rows = np.empty(len(cloud.points), dtype=[*kinds, ("difference", "<f4"), ("sigma", "<f4")])
    pull = np.nan_to_num(found.difference / (2.0 * found.sigma))
    tint = np.clip(np.stack([1.0 + pull, 1.0 - np.abs(pull), 1.0 - pull], axis=1), 0.0, 1.0)
    tint[~found.compared] = 0.5
    columns = [*cloud.points.T, *cloud.normals.T, *np.rint(255.0 * tint).T]
    for (name, _), column in zip(kinds, columns, strict=True):
        rows[name] = column
    rows["difference"], rows["sigma"] = found.difference, found.sigma
    write_ply_file(path, rows, comment="semsfm_colmap: surface of the even frames against this one")


def depth_map_path(folder: Path | str, image_name: str) -> Path:
    """Where the depth map of an image lies: ``<folder>/<image name>.npz``."""
    return Path(folder) / f"{image_name}.npz"


def write_depth_map(folder: Path | str, depth_map: DepthMap) -> Path:
    """Save a depth map (float32 depth, float16 sigma, confidence in 1/255 steps)."""
    path = depth_map_path(folder, depth_map.image_name)
    arrays: dict[str, Array] = {"depth": np.asarray(depth_map.depth, dtype=np.float32)}
    if depth_map.confidence is not None:
        arrays["confidence"] = np.rint(np.clip(depth_map.confidence, 0, 1) * 255).astype(np.uint8)
    if depth_map.sigma is not None:
        with np.errstate(over="ignore"):  # what says nothing becomes infinite
            arrays["sigma"] = np.asarray(depth_map.sigma, dtype=np.float16)
    with file_aside(path) as aside, aside.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **arrays)
    return path


def read_depth_map(folder: Path | str, image_name: str) -> DepthMap:
    """Load what `write_depth_map` saved."""
    path = depth_map_path(folder, image_name)
    try:
        with path.open("rb") as file, np.load(file) as data:
            depth = data["depth"]
            confidence = data.get("confidence")
            sigma = data.get("sigma")
        for values in (depth, confidence, sigma):
            if values is not None and (values.ndim != 2 or values.shape != depth.shape):
                raise ValueError(f"an array of shape {values.shape}")
        depth_map = DepthMap(
            image_name=image_name,
            depth=depth,
            confidence=None if confidence is None else confidence.astype(np.float32) / 255.0,
            sigma=None if sigma is None else sigma.astype(np.float32),
        )
    except FileNotFoundError:
        raise InputError(f"{path} is missing: run the densify step first.") from None
    except UNREADABLE as error:
        raise InputError(
            f"{path} is not a depth map ({error}): delete it, densify again."
        ) from error
    return depth_map


def project_views(reconstruction: Reconstruction, folder: Path | str) -> LazyViews:
    """The depth maps of a project with their cameras, each read when it is asked for."""
    rows = [
        i
        for i, name in enumerate(reconstruction.image_names)
        if depth_map_path(folder, name).is_file()
    ]

    def view(k: int) -> DepthView:
        i = rows[k]
        depth_map = read_depth_map(folder, reconstruction.image_names[i])
        return parallel_view(reconstruction.cameras, i, reconstruction.image_size_px[i], depth_map)

    return LazyViews(view, len(rows))


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
