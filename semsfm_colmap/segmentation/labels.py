"""The parts: their names, the numbers that stand for them in files, and what a labelling holds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from semsfm_colmap.types import Bool, Float, Int

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


@dataclass(frozen=True, kw_only=True, eq=False)
class Labelling:
    """A label for each point of a cloud."""

    label: Int
    """(N,) keys of `names`"""
    confidence: Float
    """(N,) 0.5 to 1: probability of the label against the other one that was considered"""
    names: Mapping[int, str]
    message: str = ""
    """why it came out so, in a sentence"""
    diagnostics: Mapping[str, Any] = field(default_factory=dict)

    def is_part(self, name: str) -> Bool:
        """(N,) the points of the part of that name; none where there is no such part."""
        numbers = [number for number, known in self.names.items() if known == name]
        return np.isin(self.label, numbers)


def whole(num_points: int, message: str) -> Labelling:
    """Everything is specimen."""
    return Labelling(
        label=np.full(num_points, SPECIMEN),
        confidence=np.ones(num_points),
        names=NAMES,
        message=message,
    )
