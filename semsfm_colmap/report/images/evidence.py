"""What the stages have left of the images themselves, handed in by the caller.

A model holds what was kept. What became of everything else is told by the keypoints and matches of
the database, by the tracks that were built from them, and by the depth maps.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from semsfm_colmap.records import MATCH_STEPS
from semsfm_colmap.types import Array, Bool, DepthMap, Int, Observations


@dataclass(frozen=True, kw_only=True, eq=False)
class ImageEvidence:
    """The measured keypoints of one image, K of them."""

    keypoints: Array
    """(K, 2 to 6) as COLMAP stores them: x, y in px, then scale and angle, or the affine shape"""
    in_track: Bool
    """(K,) True where a track was built from it"""


@dataclass(frozen=True, kw_only=True, eq=False)
class PairEvidence:
    """The matches of one image pair, L of them, and which filter dropped each."""

    names: tuple[str, str]
    matches: Int
    """(L, 2) rows of the measured keypoints of the two images"""
    step: Int
    """(L,) places in `MATCH_STEPS`: the filter that dropped it, or the last, which is kept"""
    steps_known: bool = True
    """False where only kept and dropped are told apart: dropped ones have step 0"""

    def __post_init__(self) -> None:
        if len(self.step) != len(self.matches):
            raise ValueError(f"{len(self.step)=} but expected {len(self.matches)=}")

    @property
    def verified(self) -> Bool:
        """(L,) True where the match went on to the tracks."""
        return np.asarray(self.step == len(MATCH_STEPS) - 1)


@dataclass(frozen=True, kw_only=True, eq=False)
class SeriesEvidence:
    """All of it; images without keypoints or maps are simply not there."""

    read_pixels: Callable[[str], Array]
    """(H, W) uint8 of the prepared image of that name"""
    images: Mapping[str, ImageEvidence]
    pairs: tuple[PairEvidence, ...] = ()
    tracks: Observations | None = None
    """As they were built from the matches, before any filter; images numbered as `track_names`"""
    track_names: tuple[str, ...] = ()
    read_depth_map: Callable[[str], DepthMap | None] = lambda name: None
    """None where the image has none"""
