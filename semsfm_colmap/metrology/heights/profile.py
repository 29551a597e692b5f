"""Profile surface texture parameters of ISO 21920-2 along a line.

Heights z(x) at a constant spacing, after the S- and L-filters of ISO 16610-21; for primary profiles
the same formulas give P instead of R, for waviness W. The evaluation length is divided into
`num_sections` section lengths (5 by default); on each, with the mean line of the whole,

    Rp, Rv, Rz   means over the sections of the highest peak, the lowest pit, and their sum
    Rt           highest peak to lowest pit of the evaluation length
    Ra, Rq, Rsk, Rku   as Sa, Sq, Ssk, Sku, over the evaluation length
    Rdq, Rda     root mean square and mean of |dz/dx| (seven-point formula)
    Rdl          length of the profile over that of its mean line, minus 1, in %
    Rsm          mean width of the profile elements: a peak and the pit beside it, that both rise
                 more than 10 % of Rz over the mean line and are at least 1 % of a section wide
    Rk, Rpk, Rvk, Rmrk1, Rmrk2   of the material ratio curve, the ratios in %

The filters with their nesting indices are the caller's: ISO 21920-3 gives defaults.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import map_coordinates

from semsfm_colmap.errors import InputError
from semsfm_colmap.metrology.heights.areal import height_parameters
from semsfm_colmap.metrology.heights.filters import gaussian
from semsfm_colmap.metrology.heights.gradients import derivative
from semsfm_colmap.metrology.heights.height_map import HeightMap
from semsfm_colmap.metrology.heights.material_ratio import MaterialRatio
from semsfm_colmap.types import Float

LENGTHS = ("a", "q", "p", "v", "z", "t", "sm", "k", "pk", "vk")
"""Parameters, without their letter, that are lengths."""
PERCENTAGES = ("dl", "mrk1", "mrk2")
NUM_SECTIONS = 5
MIN_HEIGHT = 0.10
"""Share of Rz that an element must rise and fall [ISO 21920-2]."""
MIN_WIDTH = 0.01
"""Share of a section length that half an element must be wide."""
MIN_POINTS = 50


def profile_unit(name: str, unit: str) -> str:
    """The unit of a parameter such as Rq of a profile whose lengths are in `unit`."""
    return unit if name[1:] in LENGTHS else "%" if name[1:] in PERCENTAGES else ""


def line_profile(
    height_map: HeightMap, start: tuple[float, float], end: tuple[float, float]
) -> tuple[Float, float]:
    """Heights along a straight line of a map, bilinear between cells, nan beside a hole.

    Parameters
    ----------
    start, end : x, y in the unit of the map, from the middle of row 0, column 0

    Returns
    -------
    heights (N,) and their spacing, about that of the cells

    Raises
    ------
    InputError
        The line has no length, or lies outside of the map.

    """
    steps = np.array(height_map.spacing)
    a, b = (np.array(p, dtype=np.float64) / steps for p in (start, end))
    length = float(np.linalg.norm((b - a) * steps))
    num = int(np.ceil(np.abs(b - a).max())) + 1
    if num < 2:
        raise InputError("The line of the profile has no length: give two places apart.")
    x, y = a[:, None] + (b - a)[:, None] * np.linspace(0.0, 1.0, num)
    z = map_coordinates(height_map.z, [y, x], order=1, mode="constant", cval=np.nan)
    if not np.isfinite(z).any():
        raise InputError("The line of the profile crosses no measured cell: draw another one.")
    return z, length / (num - 1)


def roughness_profile(
    z: Float, spacing: float, s_nesting_index: float, l_nesting_index: float
) -> Float:
    """The R-profile: Gaussian low pass with Nis, minus what the one with Nic passes: (N,)."""
    smooth = gaussian(z, (spacing,), s_nesting_index)
    return np.asarray(smooth - gaussian(smooth, (spacing,), l_nesting_index))


def profile_parameters(
    z: Float, spacing: float, *, num_sections: int = NUM_SECTIONS, letter: str = "R"
) -> dict[str, float]:
    """The parameters above; lengths in the unit of z and spacing, ratios in %.

    Parameters
    ----------
    z : (N,) heights; nan are points that were not measured
    spacing : of the points
    letter : R, P or W, what the names begin with

    Raises
    ------
    InputError
        Fewer than 50 points were measured.

    """
    known = np.isfinite(z)
    if known.sum() < MIN_POINTS:
        raise InputError(
            f"The profile has {known.sum()} measured points, {MIN_POINTS} are needed: draw a "
            "longer line."
        )
    away = z - np.mean(z[known])
    whole = height_parameters(away)
    sections = [s[np.isfinite(s)] for s in np.array_split(away, num_sections)]
    peaks = [s.max() for s in sections if len(s)]
    pits = [-s.min() for s in sections if len(s)]
    slope = derivative(away, spacing, 0)
    slope = slope[np.isfinite(slope)]
    core = MaterialRatio.of(away).core()
    Rz = float(np.mean(peaks) + np.mean(pits))
    section_length = len(z) * spacing / num_sections
    found = {
        "a": whole["Sa"],
        "q": whole["Sq"],
        "p": float(np.mean(peaks)),
        "v": float(np.mean(pits)),
        "z": Rz,
        "t": whole["Sz"],
        "sk": whole["Ssk"],
        "ku": whole["Sku"],
        "dq": float(np.sqrt(np.mean(slope**2))) if len(slope) else np.nan,
        "da": float(np.mean(np.abs(slope))) if len(slope) else np.nan,
        "dl": 100.0 * float(np.mean(np.hypot(1.0, slope)) - 1.0) if len(slope) else np.nan,
        "sm": mean_element_width(away, spacing, MIN_HEIGHT * Rz, MIN_WIDTH * section_length),
        "k": core.k,
        "pk": core.pk,
        "vk": core.vk,
        "mrk1": 100.0 * core.mr1,
        "mrk2": 100.0 * core.mr2,
    }
    return {letter + name: value for name, value in found.items()}


def mean_element_width(z: Float, spacing: float, min_height: float, min_width: float) -> float:
    """Rsm: distance of the first to the last upward crossing of the mean line, a whole element.

    A piece between two crossings counts as a peak or a pit when it reaches `min_height` from the
    mean line and is at least `min_width` wide; other pieces belong to the one before.

    Returns
    -------
    nan where no two whole elements are there, or the profile has holes

    """
    if not np.isfinite(z).all():
        return float("nan")
    sign = np.where(z >= 0.0, 1, -1)
    change = np.flatnonzero(sign[1:] != sign[:-1])
    crossing = change + z[change] / (z[change] - z[change + 1])
    ends = np.concatenate([[0], change + 1, [len(z)]])
    edges = np.concatenate([[0.0], crossing, [len(z) - 1.0]])
    upward: list[float] = []
    last = 0
    for k in range(len(ends) - 1):
        piece = z[ends[k] : ends[k + 1]]
        tall = np.abs(piece).max() > min_height
        wide = (edges[k + 1] - edges[k]) * spacing >= min_width
        if not (tall and wide):
            continue
        this = int(np.sign(piece[0] if piece[0] != 0.0 else piece.max()))
        if this > 0 and last < 0:
            upward.append(float(edges[k]))
        last = this
    if len(upward) < 2:
        return float("nan")
    return (upward[-1] - upward[0]) * spacing / (len(upward) - 1)
