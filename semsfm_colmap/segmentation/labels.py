"""What a labelling of a cloud holds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from semsfm_colmap.segmentation.names import NAMES, SPECIMEN
from semsfm_colmap.types import Bool, Float, Int


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
