"""Options of the measurement."""

from __future__ import annotations

from dataclasses import dataclass

from semsfm_colmap.bounds import Checked, RelativeSigma

PIXEL_SIZE_SIGMA = 0.03
"""Magnifications calibrated by ASTM E766 are right within 5 % (its sections 4.1 and 4.2), which as
a uniform bound is a standard deviation of 2.9 %."""


@dataclass(frozen=True, kw_only=True)
class MetrologyOptions(Checked):
    """What is known of the scale."""

    pixel_size_sigma: RelativeSigma = PIXEL_SIZE_SIGMA
    """Relative standard deviation of the pixel size; the default stands for a magnification within
    5 % (ASTM E766). Lengths in px have none."""
