"""Options of taking over a changed model."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class AdoptionOptions:
    """How far a changed model may be from the old one."""

    max_rotation_deg: float = 0.5
    """No camera may turn further, once the worlds are aligned."""
    max_magnification_change: float = 0.005
    """Nor change its magnification, relative to the others, by more than this share."""
    max_focal_change: float = 1e-6
    """Relative change of the focal length that still counts as fixed."""
    max_error_increase: float = 0.05
    """The mean error of the observations that both models have may grow by this share."""
    max_lost_observations: float = 0.5
    """Share of the old observations that may be gone."""
    max_deviation_px: float = 0.1
    """The changed cameras must be parallel to this."""
