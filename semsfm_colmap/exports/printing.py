"""A mesh as a printer takes it: in millimetres, to scale.

A specimen of some micrometres is printed enlarged: ``X_mm = scale_factor * X_um / 1000``. In a
world of other units, for series whose pixel size nobody knows and for models of others, the unit
takes the place of the micrometre.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from semsfm_colmap.errors import InputError
from semsfm_colmap.exports.options import FormatOptions
from semsfm_colmap.exports.scene import ExportScene, Summary
from semsfm_colmap.io.open3d_library import import_open3d
from semsfm_colmap.io.ply import read_ply_mesh
from semsfm_colmap.surface.mesh.crossings import crossing_faces, crossing_sentence
from semsfm_colmap.types import TriangleMesh

FILE_TYPES = ("stl", "3mf")
MM_PER_UM = 1e-3
NOT_CLOSED = (
    "the mesh has holes, which printers refuse or close on their own: make it with "
    "`semsfm mesh --surface.watertight`"
)


def write_printable(
    scene: ExportScene, folder: Path, options: FormatOptions, file_type: str
) -> Summary:
    """``mesh.<file type>`` of a project; says how large it is and whether it is closed."""
    if scene.mesh_path is None:
        raise InputError("the mesh is missing: only model 0 has one")
    summary = print_mesh(
        scene.mesh_path, folder, options, file_type, scene.reconstruction.world_unit
    )
    return {"num_images": len(scene.names), **summary}


def print_mesh(
    mesh_path: Path, folder: Path, options: FormatOptions, file_type: str, unit: str
) -> Summary:
    """``mesh.<file type>`` of a mesh.ply in a world of some unit, empty where it is not known."""
    import_open3d()  # which finds faces that cross
    surface = _read(mesh_path)
    mesh = printable(surface, options.scale_factor)
    data = mesh.export(file_type=file_type)
    (folder / f"mesh.{file_type}").write_bytes(data)
    num_crossing = len(crossing_faces(surface)) if mesh.is_watertight else 0
    notes = [] if mesh.is_watertight else [NOT_CLOSED]
    if num_crossing:
        notes.append(crossing_sentence(num_crossing))
    if unit != "um":
        counted = "pixels" if unit == "px" else "units of the model"
        notes.append(f"how large the specimen is is not known: the scale factor counts {counted}")
    return {
        "num_points": len(mesh.vertices),
        "num_faces": len(mesh.faces),
        "watertight": bool(mesh.is_watertight),
        "scale_factor": options.scale_factor,
        "size_mm": [float(length) for length in mesh.extents],
        "volume_mm3": float(mesh.volume) if mesh.is_watertight else None,
        "notes": notes,
    }


def _read(path: Path) -> TriangleMesh:
    if not path.is_file():
        raise InputError(f"{path} is missing: run `semsfm mesh` first")
    return read_ply_mesh(path)


def printable(mesh: TriangleMesh, scale_factor: float) -> Any:
    """The mesh in millimetres (`trimesh.Trimesh`), the lowest corner of its box at the origin."""
    import trimesh

    vertices = mesh.vertices * (MM_PER_UM * scale_factor)
    return trimesh.Trimesh(
        vertices=vertices - vertices.min(axis=0), faces=mesh.faces, process=False, validate=False
    )
