"""The order of the images in the report: the series as acquired, numbered from 1.

The reconstruction keeps its own order (and lacks the images that were not registered), so the
report maps both to one list of frames once, here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from semsfm_colmap.report.inputs import ReportInputs
from semsfm_colmap.types import Int


@dataclass(frozen=True, kw_only=True, eq=False)
class Frames:
    """All images, F of them, in acquisition order; the first has number 1."""

    names: tuple[str, ...]
    registered: Int
    """(M,) positions in `names` of the registered images, increasing"""
    image_idx: Int
    """(M,) their indices in the reconstruction"""

    @property
    def numbers(self) -> Int:
        """(M,) frame numbers of the registered images, from 1."""
        return self.registered + 1

    @property
    def missing(self) -> tuple[str, ...]:
        """Names of the images that were given but not registered."""
        found = set(self.registered.tolist())
        return tuple(name for k, name in enumerate(self.names) if k not in found)

    def rank_of_image(self) -> Int:
        """(M,) for each image index of the reconstruction, its place among the registered."""
        rank = np.empty(len(self.image_idx), dtype=np.int64)
        rank[self.image_idx] = np.arange(len(self.image_idx))
        return rank


def order_frames(inputs: ReportInputs) -> Frames:
    """The frames of the series; images only the reconstruction knows come last, in its order."""
    image_idx_of_name = {name: i for i, name in enumerate(inputs.reconstruction.image_names)}
    names = tuple(dict.fromkeys((*inputs.series.names, *inputs.reconstruction.image_names)))
    registered = [k for k, name in enumerate(names) if name in image_idx_of_name]
    return Frames(
        names=names,
        registered=np.array(registered, dtype=np.int64),
        image_idx=np.array([image_idx_of_name[names[k]] for k in registered], dtype=np.int64),
    )
