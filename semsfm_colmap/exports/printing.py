"""The mesh of a project as a printer takes it: in millimetres, to scale.

A specimen of some micrometres is printed enlarged: ``X_mm = scale_factor * X_um / 1000``. In a
world of pixels, for series whose pixel size nobody knows, ``X_mm = scale_factor * X_px / 1000``.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.exports.options import FormatOptions
from semsfm_colmap.exports.scene import ExportScene, Summary
from semsfm_colmap.io.ply import read_ply_mesh

MM_PER_UM = 1e-3
NOT_CLOSED = (
    "the mesh has holes, which printers refuse or close on their own: make it with "
    "`semsfm mesh --surface.watertight`"
)


def write_printable(
    scene: ExportScene, folder: Path, options: FormatOptions, file_type: str
) -> Summary:
    """``mesh.<file type>``; says how large it is and whether it is closed."""
    if not (np.isfinite(options.scale_factor) and options.scale_factor > 0):
        raise UsageError(f"scale_factor = {options.scale_factor:g}: it must be positive")
    mesh = printable(scene, options)
    data = mesh.export(file_type=file_type)
    (folder / f"mesh.{file_type}").write_bytes(data)
    unit = scene.reconstruction.world_unit
    notes = [] if mesh.is_watertight else [NOT_CLOSED]
    if unit != "um":
        notes.append("the pixel size is not known: the scale factor counts pixels")
    return {
        "num_images": len(scene.names),
        "num_points": len(mesh.vertices),
        "num_faces": len(mesh.faces),
        "watertight": bool(mesh.is_watertight),
        "scale_factor": options.scale_factor,
        "size_mm": [float(length) for length in mesh.extents],
        "volume_mm3": float(mesh.volume) if mesh.is_watertight else None,
        "notes": notes,
    }


def printable(scene: ExportScene, options: FormatOptions) -> Any:
    """The mesh in millimetres (`trimesh.Trimesh`), the lowest corner of its box at the origin."""
    import trimesh

    path = scene.mesh_path
    if path is None or not path.is_file():
        raise InputError(
            f"{path or 'the mesh'} is missing: run `semsfm mesh` first (only model 0 has one)"
        )
    mesh = read_ply_mesh(path)
    vertices = mesh.vertices * (MM_PER_UM * options.scale_factor)
    return trimesh.Trimesh(
        vertices=vertices - vertices.min(axis=0), faces=mesh.faces, process=False, validate=False
    )
