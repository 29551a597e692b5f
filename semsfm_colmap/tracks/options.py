"""Options of the track stage."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge

from semsfm_colmap.bounds import Checked


@dataclass(frozen=True, kw_only=True)
class TrackOptions(Checked):
    """From verified pairs to tracks."""

    min_length: Annotated[int, Ge(2)] = 2
    """Fewest observations of a track."""
    cycle_consistency: bool = True
    """Drop a match that more three-view cycles contradict than support, as repetitive texture gives
    them, and one of images far apart that no image between them shows."""
