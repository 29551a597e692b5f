"""Options of a height map and of what is measured on it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from annotated_types import Ge

from semsfm_colmap.bounds import Checked, Count, Positive, RelativeSigma, Seed


@dataclass(frozen=True, kw_only=True)
class HeightMapOptions(Checked):
    """Grid, form, filters and what is known of the scale; lengths in world units."""

    spacing: Positive | None = None
    """Distance of the cells; default: mean distance of the mesh's vertices."""
    level: Literal["plane", "polynomial", "sphere", "none"] = "plane"
    """Form that is taken out (F-operation)."""
    degree: Count = 2
    """Of a polynomial form."""
    s_filter: Positive | None = None
    """Nesting index of the S-filter; default: twice what the reconstruction has filtered off."""
    l_filter: Positive | None = None
    """Nesting index of the L-filter; default: none, an S-F surface."""
    robust: bool = False
    """The L-filter is the robust one: pits and peaks do not pull the large scale."""
    pixel_size_sigma: RelativeSigma = 0.03
    """Relative standard deviation of the pixel size; the default stands for a magnification within
    5 % (ASTM E766). Lengths in px have none."""
    num_draws: Annotated[int, Ge(2)] = 30
    """Of the Monte Carlo behind the uncertainties, which are known to 1 / root(2 num_draws)."""
    seed: Seed = 0
    """Of the Monte Carlo."""
