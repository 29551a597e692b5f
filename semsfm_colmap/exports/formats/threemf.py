"""3MF: triangles with shared vertices, and the unit, millimetres, in the file."""

from __future__ import annotations

from pathlib import Path

from semsfm_colmap.exports.options import FormatOptions
from semsfm_colmap.exports.printing import write_printable
from semsfm_colmap.exports.scene import ExportScene, Summary


def write(scene: ExportScene, folder: Path, options: FormatOptions) -> Summary:
    """mesh.3mf"""
    return write_printable(scene, folder, options, "3mf")
