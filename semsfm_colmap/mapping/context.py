"""What mapping a series needs to know besides its observations; read-only, handed on whole."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from semsfm_colmap.factorization.options import FactorizationOptions
from semsfm_colmap.matching.guided.options import GuidedOptions
from semsfm_colmap.motion.prior import TiltPrior
from semsfm_colmap.refinement.options import RefinementOptions
from semsfm_colmap.types import Array, Bool, Float, Int, ParallelMap


@dataclass(frozen=True, kw_only=True, eq=False)
class Guide:
    """The images, for a second pass that looks for every point in every image."""

    read_image: Callable[[int], Array]
    """number in the series -> pixels (H, W)"""
    read_mask: Callable[[int], Bool | None]
    read_keypoints: Callable[[int], Float]
    """number in the series -> all measured keypoints (K, 2) px"""
    options: GuidedOptions
    parallel_map: ParallelMap = map
    """over the images in which points are looked for"""


def silent(sentence: str) -> None:
    """Say nothing."""


PHASES = {
    "first model": 0.2,
    "guided passes": 0.5,
    "camera models": 0.1,
    "error bars and hand": 0.2,
}
"""What mapping goes through, and about what share of its time each takes: series of 13 to 48
images."""


def unwatched(phase: str, done: int, total: int) -> None:
    """Nobody watches how far mapping has come."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SeriesContext:
    """A series of images, what is known of it, and how it is to be mapped."""

    image_names: tuple[str, ...]
    image_size_px: Int
    """(M, 2) width, height"""
    factorization: FactorizationOptions
    refinement: RefinementOptions
    pixel_size_um: float | None = None
    pixel_size_source: str = "none"
    tilt: TiltPrior | None = None
    """known angles; used as a prior where the images do not contradict them"""
    displacement_um: Float | None = None
    """(M,) of the actuator that turned the specimen, nan where none is recorded; None: nowhere"""
    guide: Guide | None = None
    """None: no second pass"""
    scanned: bool = False
    """the images are known to come from a scanning instrument"""
    series_idx: Int | None = None
    """(M,) which of several merged series each image is from; None: all are of one"""
    seed: int = 0
    say: Callable[[str], None] = silent
    """called with a sentence after each step"""
    progress: Callable[[str, int, int], None] = unwatched
    """called with one of `PHASES`, how much of it is done and how much there is"""

    @property
    def height_px(self) -> Float:
        """(M,) heights of the images."""
        return self.image_size_px[:, 1].astype(np.float64)

    @property
    def is_scanned(self) -> bool:
        """Whether the images were scanned row by row, by what is known or by the user's word."""
        word = self.refinement.scanned
        return self.scanned if word == "auto" else word == "yes"

    def names_of(self, images: Int) -> tuple[str, ...]:
        """The names of some images."""
        return tuple(self.image_names[i] for i in images)
