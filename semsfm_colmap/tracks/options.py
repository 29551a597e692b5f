"""Options of the track stage."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class TrackOptions:
    """From verified pairs to tracks."""

    min_length: int = 2
    """Fewest observations of a track."""
    cycle_consistency: bool = True
    """Drop a match that more three-view cycles contradict than support, as repetitive texture gives
    them, and one of images far apart that no image between them shows."""
