"""Options of the segmentation. Shares are of the cloud or of the images, as said."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge

from semsfm_colmap.bounds import Checked, Count, NotNegative, Positive, Share

ALL = "all"
"""In place of the name of a part: no part alone."""


@dataclass(frozen=True, kw_only=True)
class SegmentationOptions(Checked):
    """How the parts of a surface are told apart."""

    part: str = ALL
    """The part that is meshed: a name of segments/segments.json, such as specimen; all: everything.
    `semsfm mesh --segment specimen` is short for this."""
    border_margin: Share = 0.04
    """A point is at the border of an image within this share of its shorter side."""
    min_border_share: Share = 0.5
    """A point touches the border when it is there in this share of the images."""
    max_support_coverage: Share = 0.4
    """What touches more of the frame's outline than this is a sheet, not a coil or a stalk."""
    widening: Positive = 1.25
    """The specimen begins where the cross-section exceeds that of its support by this factor."""
    min_part_share: Share = 0.02
    """Parts with a smaller share of the points are none."""
    min_island_share: Share = 0.005
    """Smaller patches of one label within the other are given to it."""
    num_graph_neighbors: Count = 10
    """Neighbours that a point shares its label with."""
    num_roughness_neighbors: Annotated[int, Ge(3)] = 24
    """Neighbours whose distance from their plane is the roughness."""
    smoothness: NotNegative = 5.0
    """Weight of what the neighbours say against what the point itself looks like."""
    min_height_sigma: Positive = 6.0
    """What stands out from a substrate this many deviations of its height is no substrate."""
