"""Options of the matching stage."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, kw_only=True)
class MatchingOptions:
    """Which pairs are matched and how matches are verified."""

    pairs: Literal["auto", "exhaustive", "sequential"] = "auto"
    """auto: exhaustive up to `max_exhaustive_images`, else neighbours in the sequence."""
    max_exhaustive_images: int = 16
    """Up to so many images all pairs are matched."""
    overlap: int = 6
    """How many following images each image is matched with in a sequence."""
    loop_closure: bool = True
    """Match the last images of a sequence with the first: a full turn closes."""
    max_ratio: float = 0.8
    """Lowe's ratio of the best to the second best descriptor distance."""
    exclusion_px: float = 2.0
    """A second best within this distance of the best shows the same spot, at another scale or
    orientation, and is no rival in the ratio; below 0 every other is."""
    max_error_px: float = 2.0
    """Distance to the affine epipolar constraint up to which a match is an inlier."""
    ransac_trials: int = 500
    """Random 4-match samples per pair."""
    min_num_inliers: int = 15
    """Fewest inliers of a verified pair."""
    distance_filter_sigmas: float = 3.0
    """Matches displaced by so many standard deviations more or less than the median of their pair
    are dropped (the paper's distance filter, 2 to 3); 0 switches it off."""
    static_radius_px: float = 0.5
    """A match that moved less than this may belong to the background, not to the specimen."""
    static_excess: float = 5.0
    """Static matches are rejected where they are so many times denser than the matches that moved a
    little more; 0 switches it off."""
