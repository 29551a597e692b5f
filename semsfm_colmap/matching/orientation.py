"""Whether keypoints keep the image's orientation, or turn to their dominant gradient.

Where the specimen does not turn in the image plane, as on a tilting stage, the dominant gradient of
a region is one more thing that can come out differently in two views; where it does turn, only
that finds the region again. Which of the two a series is shows in a few of its pairs.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from semsfm_colmap.matching.nearest import match_nearest
from semsfm_colmap.matching.options import MatchingOptions
from semsfm_colmap.matching.verify import verify_pair
from semsfm_colmap.types import Features

GAP = 5
"""How far apart the farther pairs are: what turns little from image to image turns more there."""
LONG_SERIES = 20
"""The trial is made at one place of a shorter series, and at two of a longer one."""
SIGMAS = 2.0
"""Numbers of places that differ by less, in units of the root of their sum, do not differ."""

FeaturesOf = Callable[[Sequence[int], bool], Sequence[Features]]
"""Features with descriptors of the images of these numbers, upright or turned."""


@dataclass(frozen=True, kw_only=True)
class Trial:
    """Places matched in the near and the far pairs, turned and upright."""

    near: tuple[int, int]
    far: tuple[int, int]

    @property
    def upright(self) -> bool:
        """Upright, where that finds more among the near or the far pairs and no less elsewhere."""
        gains = [
            (up - turned) / math.sqrt(max(up + turned, 1)) for turned, up in (self.near, self.far)
        ]
        return max(gains) > SIGMAS and min(gains) > -SIGMAS


def pilot_images(num_images: int) -> list[tuple[int, int, int]]:
    """A few images, each with its next one and one farther on."""
    gap = min(GAP, num_images - 1)
    places = (0.5,) if num_images < LONG_SERIES else (0.2, 0.7)
    first = [round(place * (num_images - 1 - gap)) for place in places]
    return [(k, k + 1, k + gap) for k in first]


def try_orientations(num_images: int, features_of: FeaturesOf, *, seed: int = 0) -> Trial:
    """Match a few pairs both ways and verify what is found.

    Parameters
    ----------
    num_images : three or more, in acquisition order
    features_of : called once turned, once upright

    """
    trios = pilot_images(num_images)
    images = sorted({k for trio in trios for k in trio})
    near, far = [], []
    for upright in (False, True):
        features = dict(zip(images, features_of(images, upright), strict=True))

        def count(i: int, j: int, of: Mapping[int, Features] = features) -> int:
            return _num_places(of[i], of[j], (i, j), seed)

        near.append(sum(count(i, j) for i, j, _ in trios))
        far.append(sum(count(i, k) for i, j, k in trios if k > j))
    return Trial(near=(near[0], near[1]), far=(far[0], far[1]))


def _num_places(first: Features, second: Features, pair: tuple[int, int], seed: int) -> int:
    """Places of the first image that have a verified match in the second."""
    options = MatchingOptions()
    matches = match_nearest(
        first.descriptors,
        second.descriptors,
        max_ratio=options.max_ratio,
    ).keypoints
    geometry = verify_pair(pair, first.xy, second.xy, matches, options, seed)
    if geometry.F is None:
        return 0
    # a place with several dominant gradients has several keypoints
    return len(np.unique(first.xy[matches[geometry.inlier, 0]], axis=0))
