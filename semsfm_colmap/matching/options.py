"""Options of the matching stage."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from annotated_types import Ge, Interval

from semsfm_colmap.bounds import Checked, Count, CountOrNone, NotNegative, Positive


@dataclass(frozen=True, kw_only=True)
class MatchingOptions(Checked):
    """Which pairs are matched and how matches are verified."""

    pairs: Literal["auto", "exhaustive", "sequential"] = "auto"
    """auto: exhaustive up to `max_exhaustive_images`, else neighbours in the sequence."""
    max_exhaustive_images: CountOrNone = 16
    """Up to so many images all pairs are matched."""
    overlap: Count = 6
    """How many following images each image is matched with in a sequence."""
    loop_closure: bool = True
    """Match the last images of a sequence with the first: a full turn closes."""
    max_ratio: Annotated[float, Interval(gt=0, le=1)] = 0.8
    """Lowe's ratio of the best to the second best descriptor distance."""
    exclusion_px: float = 2.0
    """A second best within this distance of the best shows the same spot, at another scale or
    orientation, and is no rival in the ratio; below 0 every other is."""
    max_error_px: Positive = 2.0
    """Distance to the affine epipolar constraint up to which a match is an inlier."""
    ransac_trials: Count = 500
    """Random 4-match samples per pair."""
    min_num_inliers: Annotated[int, Ge(4)] = 15
    """Fewest inliers of a verified pair."""
    distance_filter_sigmas: NotNegative = 3.0
    """Matches displaced by so many standard deviations more or less than the median of their pair
    are dropped (the paper's distance filter, 2 to 3); 0 switches it off."""
    static_radius_px: NotNegative = 0.5
    """A match that moved less than this may belong to the background, not to the specimen."""
    static_excess: NotNegative = 5.0
    """Static matches are rejected where they are so many times denser than the matches that moved a
    little more; 0 switches it off."""
