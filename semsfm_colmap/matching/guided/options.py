"""Options of the guided second pass."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge

from semsfm_colmap.bounds import (
    Angle,
    Checked,
    Correlation,
    Count,
    CountOrNone,
    NotNegative,
    Positive,
)


@dataclass(frozen=True, kw_only=True)
class GuidedOptions(Checked):
    """After a first map every point is looked for in every image that should see it, by aligning
    its patch under the predicted affine warp: tracks grow and join, their places become finer.
    """

    enabled: bool = True
    """Do the second pass."""
    rounds: Count = 5
    """Most passes, each from the model that the one before has led to: the first aligns what is
    known, the others look everywhere, of many tracks for a sample until the last."""
    converged_deg: NotNegative = 0.02
    """Once a pass turns the cameras by less than this (root mean square) there is no other, unless
    it found many new observations."""
    patch_radius_px: Count = 8
    """Half width of the aligned patch: a larger one is less noisy, but bends further away from its
    tangent plane and from its own brightness."""
    window_sigma_px: Positive = 4.5
    """Standard deviation of its Gaussian window."""
    high_pass_px: NotNegative = 0.0
    """Structure much coarser than this many px is taken out before alignment: coarse brightness is
    shading, which moves over a specimen that turns. 0: the finest that the images bear."""
    max_view_angle_deg: Angle = 65.0
    """A point is looked for where its surface is seen at up to this angle."""
    max_baseline_deg: Angle = 60.0
    """A patch is compared with views at up to this angle from its reference view."""
    max_shift_px: Positive = 2.0
    """How far from its predicted place a patch may be found."""
    min_correlation: Correlation = 0.65
    """Smallest normalised cross-correlation of an aligned patch."""
    min_separation_px: NotNegative = 1.5
    """Of two tracks that lie closer than this in two images the shorter is dropped: they show the
    same spot."""
    min_track_length: Annotated[int, Ge(2)] = 3
    """Shorter tracks are not kept."""
    fill_up_to: CountOrNone = 10000
    """While there are fewer points than this, keypoints without a match are tried as points too,
    where the surface around them is known; 0: never."""
    own_weights: bool = False
    """Weigh each observation in the last adjustment by what its alignment is worth. It brought the
    cameras no nearer to the truth, and programs that know no weights, like COLMAP, then find
    another optimum for the same observations."""
