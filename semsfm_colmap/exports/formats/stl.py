"""STL, binary: triangles in millimetres. The file itself names no unit."""

from __future__ import annotations

from pathlib import Path

from semsfm_colmap.exports.options import FormatOptions
from semsfm_colmap.exports.printing import write_printable
from semsfm_colmap.exports.scene import ExportScene, Summary


def write(scene: ExportScene, folder: Path, options: FormatOptions) -> Summary:
    """mesh.stl"""
    return write_printable(scene, folder, options, "stl")
