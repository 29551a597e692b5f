"""The parts, the numbers that stand for them in files, and the names of those files."""

from __future__ import annotations

DROPPED, SPECIMEN, COIL, STALK, SUBSTRATE = range(5)
NAMES: dict[int, str] = {
    DROPPED: "dropped",
    SPECIMEN: "specimen",
    COIL: "coil",
    STALK: "stalk",
    SUBSTRATE: "substrate",
}
"""Numbers in the `label` property of PLY files; names that a person adds are numbered from 5 on."""


CLOUD_FILE = "fused.ply"
MESH_FILE = "mesh.ply"
POINTS_FILE = "points.ply"
TABLE_FILE = "segments.json"
PICTURE_FILE = "segments.png"
MASKS = "masks"
"""Names below PROJECT/segments."""
TABLE_FORMAT = "semsfm-segments"
TABLE_VERSION = 1
