"""Options of a height map and of what is measured on it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from semsfm_colmap.errors import UsageError


@dataclass(frozen=True, kw_only=True)
class HeightMapOptions:
    """Grid, form, filters and what is known of the scale; lengths in world units."""

    spacing: float | None = None
    """Distance of the cells; default: mean distance of the mesh's vertices."""
    level: Literal["plane", "polynomial", "sphere", "none"] = "plane"
    """Form that is taken out (F-operation)."""
    degree: int = 2
    """Of a polynomial form."""
    s_filter: float | None = None
    """Nesting index of the S-filter; default: twice what the reconstruction has filtered off."""
    l_filter: float | None = None
    """Nesting index of the L-filter; default: none, an S-F surface."""
    robust: bool = False
    """The L-filter is the robust one: pits and peaks do not pull the large scale."""
    pixel_size_sigma: float = 0.03
    """Relative standard deviation of the pixel size; the default stands for a magnification within
    5 % (ASTM E766). Lengths in px have none."""
    num_draws: int = 30
    """Of the Monte Carlo behind the uncertainties, which are known to 1 / root(2 num_draws)."""
    seed: int = 0
    """Of the Monte Carlo."""

    def __post_init__(self) -> None:
        if self.num_draws < 2:
            raise UsageError(f"num_draws={self.num_draws} but a standard deviation needs 2 or more")
        if not 0.0 <= self.pixel_size_sigma < 1.0:
            raise UsageError(
                f"pixel_size_sigma={self.pixel_size_sigma} but expected a share of the pixel size, "
                "0 or more and below 1"
            )
