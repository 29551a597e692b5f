"""Scale-limited surfaces of ISO 25178-2, with what the reconstruction has itself filtered off.

Matching windows, local planes and fusion average relief away. On rendered series with exact truth
(docs/metrology_areal.md) the heights of a reconstruction are those of the truth behind a Gaussian
filter of nesting index T = 18.3 px of the depth maps, give or take 1.8 px: the instrument transfer
function. Two Gaussian filters in turn are one whose index is the root of the sum of the squares, so
the surface with the S-nesting index L asked for needs only what is missing,

    S-filter with  sqrt(L^2 - T^2),

and no L below T can be had. The nearer L is to T, the more the parameters depend on T being right;
from L = 2 T on, they do so by less than 3 % for 1.8 px of T, the slope parameters included.

Along the ends and ragged rims a filter sees one side only, and so did the windows: cells with less
than 95 % of the filter's weight on measured cells are left out, 0.31 L along a straight end.

Then the form is taken out (S-F surface) and, where an L-nesting index is given, the large scale
(S-L surface).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from semsfm_colmap.errors import InputError
from semsfm_colmap.metrology.heights.filters import gaussian, robust_gaussian, support
from semsfm_colmap.metrology.heights.height_map import HeightMap, check_cells
from semsfm_colmap.metrology.heights.levelling import Form, level

TRANSFER_PX = 18.3
"""T in px of the depth maps, for windows of 7 px: the mean over fields, a grain and spores."""
TRANSFER_SIGMA_PX = 1.8
"""Standard deviation of T between them: 19.3 px on small fields, 16 px on the others."""
TRANSFER_WINDOW_PX = 7
"""The window that T was measured with: T is taken to grow in proportion."""
DEFAULT_RATIO = 2.0
"""Default S-nesting index in units of T."""
MIN_SUPPORT = 0.95
"""Least share of the S-filter's weight on measured cells: a mesh errs most at its rim, and extreme
heights that lie there were up to 8 % off."""
MIN_RATIO = 1.2
"""Least S-nesting index in units of T: below, the heights lack what the filter would keep."""


@dataclass(frozen=True, kw_only=True)
class Transfer:
    """What the reconstruction has filtered off: a Gaussian filter of this nesting index."""

    nesting_index: float
    """T, unit of the map; 0 for a surface that is known as it is, such as a truth"""
    sigma: float = 0.0

    @classmethod
    def of_depth_maps(cls, px: float, window_px: int = TRANSFER_WINDOW_PX) -> Transfer:
        """T of a surface from depth maps whose px is so long, matched with such windows."""
        length = px * window_px / TRANSFER_WINDOW_PX
        return cls(nesting_index=TRANSFER_PX * length, sigma=TRANSFER_SIGMA_PX * length)

    @property
    def default_s_index(self) -> float:
        """The smallest S-nesting index that all parameters can be trusted at."""
        return DEFAULT_RATIO * self.nesting_index


@dataclass(frozen=True, kw_only=True)
class Filtering:
    """How a scale-limited surface is made from heights."""

    s_index: float | None = None
    """S-nesting index, unit of the map; None: no filter at all"""
    l_index: float | None = None
    """L-nesting index; None: an S-F surface"""
    form: Form = "plane"
    degree: int = 2
    """of a polynomial form"""
    robust: bool = False
    """The L-filter is the robust one: pits do not pull the large scale."""


def check_filtering(filtering: Filtering, transfer: Transfer, height_map: HeightMap) -> None:
    """Refuse nesting indices that the surface does not have, or that leave nothing."""
    unit, least = height_map.unit, MIN_RATIO * transfer.nesting_index
    s, large = filtering.s_index, filtering.l_index
    if s is not None and s < least:
        raise InputError(
            f"An S-filter of {s:.4g} {unit} asks for relief that the surface does not hold: what "
            f"is shorter than {transfer.nesting_index:.4g} {unit} was averaged away; take "
            f"--s_filter {least:.4g} or more ({transfer.default_s_index:.4g} is the default)."
        )
    if large is not None and large <= (s or 0.0):
        raise InputError(
            f"The L-filter of {large:.4g} {unit} is not larger than the S-filter of {s:.4g} "
            f"{unit}: nothing would be left between them."
        )
    if large is not None and large > min(height_map.size):
        raise InputError(
            f"The L-filter of {large:.4g} {unit} is larger than the map of "
            f"{height_map.size[0]:.4g} x {height_map.size[1]:.4g} {unit}: take a smaller one."
        )


def scale_limited(
    height_map: HeightMap, filtering: Filtering, transfer: Transfer | None = None
) -> HeightMap:
    """The S-F or S-L surface of a height map.

    Parameters
    ----------
    transfer : what the heights have been filtered with already; None: nothing

    """
    z, dx, dy = height_map.z, *height_map.spacing
    if filtering.s_index is not None:
        z = np.where(
            support(height_map.measured, (dy, dx), filtering.s_index) >= MIN_SUPPORT, z, np.nan
        )
        had = 0.0 if transfer is None else transfer.nesting_index
        missing = np.sqrt(max(filtering.s_index**2 - had**2, 0.0))
        if missing > 2.0 * max(dx, dy):
            z = np.where(np.isfinite(z), gaussian(height_map.z, (dy, dx), float(missing)), np.nan)
    found = level(height_map.with_heights(z), filtering.form, degree=filtering.degree).height_map
    if filtering.l_index is not None:
        smooth = robust_gaussian if filtering.robust else gaussian
        found = found.with_heights(found.z - smooth(found.z, (dy, dx), filtering.l_index))
    return check_cells(found)
