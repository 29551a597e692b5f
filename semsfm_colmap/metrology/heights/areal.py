"""Areal surface texture parameters of ISO 25178-2 of a height map.

Heights z are those left after filtering and levelling, their mean subtracted; A is the area of the
measured cells, N their number: integrals are sums over them, holes do not count.

    Sq  = sqrt(1/A int z^2)              root mean square height
    Sa  = 1/A int |z|                    arithmetical mean height
    Sp, Sv, Sz = max z, -min z, Sp + Sv  peak height, pit depth, maximum height
    Ssk = 1/(A Sq^3) int z^3             skewness
    Sku = 1/(A Sq^4) int z^4             kurtosis
    Sdq = sqrt(1/A int z_x^2 + z_y^2)    root mean square gradient
    Sdr = 1/A int (sqrt(1 + z_x^2 + z_y^2) - 1)    developed interfacial area ratio, in %
    Sal, Str  least distance at which the autocorrelation falls to 0.2; that over the largest one
    Std       direction of the texture, degrees from x toward y
    Sk, Spk, Svk, Smr1, Smr2     core, reduced peaks and dales and their ratios in %
    Vmp, Vmc, Vvc, Vvv           volumes of peaks, core material, core void, dale void per area
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from semsfm_colmap.errors import InputError
from semsfm_colmap.metrology.heights.gradients import derivative
from semsfm_colmap.metrology.heights.height_map import HeightMap
from semsfm_colmap.metrology.heights.material_ratio import VOID_AND_CORE, MaterialRatio
from semsfm_colmap.metrology.heights.texture import decay_lengths, texture_direction
from semsfm_colmap.types import Float

LENGTHS = ("Sq", "Sa", "Sz", "Sp", "Sv", "Sal", "Sk", "Spk", "Svk", "Vmp", "Vmc", "Vvc", "Vvv")
"""Parameters that are lengths; volumes are per area."""
PERCENTAGES = ("Sdr", "Smr1", "Smr2")
ANGLES = ("Std",)
NUMBERS = ("Ssk", "Sku", "Sdq", "Str")
ISOTROPIC = 0.5
"""Str above which a texture has no direction [ISO 25178-2]."""


def areal_parameters(height_map: HeightMap) -> dict[str, float]:
    """The parameters above by name; nan where the map does not define one (see `undefined`).

    Lengths are in the unit of the map, Sdr, Smr1 and Smr2 in percent, Std in degrees.
    """
    return {
        **height_parameters(height_map.z),
        **gradient_parameters(height_map),
        **texture_parameters(height_map),
        **material_parameters(height_map.z),
    }


def height_parameters(z: Float) -> dict[str, float]:
    """Sq Sa Sz Sp Sv Ssk Sku of heights, nan left out."""
    away = z[np.isfinite(z)]
    if len(away) == 0:
        raise InputError("The height map has holes only: there is nothing to measure.")
    away = away - away.mean()
    square = away * away
    Sq = float(np.sqrt(square.mean()))
    flat = not Sq > 0.0
    return {
        "Sq": Sq,
        "Sa": float(np.abs(away).mean()),
        "Sz": float(away.max() - away.min()),
        "Sp": float(away.max()),
        "Sv": float(-away.min()),
        "Ssk": np.nan if flat else float((square * away).mean() / Sq**3),
        "Sku": np.nan if flat else float((square * square).mean() / Sq**4),
    }


def gradient_parameters(height_map: HeightMap) -> dict[str, float]:
    """Sdq Sdr over the cells whose derivatives are known (`gradients`)."""
    dx, dy = height_map.spacing
    zx, zy = derivative(height_map.z, dx, 1), derivative(height_map.z, dy, 0)
    square = (zx * zx + zy * zy)[np.isfinite(zx) & np.isfinite(zy)]
    if len(square) == 0:
        return {"Sdq": np.nan, "Sdr": np.nan}
    return {
        "Sdq": float(np.sqrt(square.mean())),
        "Sdr": 100.0 * float((np.sqrt(1.0 + square) - 1.0).mean()),
    }


def texture_parameters(height_map: HeightMap) -> dict[str, float]:
    """Sal Str Std: nan where nothing decays within the map, Std also where Str is above 0.5."""
    z = height_map.z
    if not np.nanmax(z) > np.nanmin(z):
        return {"Sal": np.nan, "Str": np.nan, "Std": np.nan}
    _, length = decay_lengths(z, height_map.spacing)
    shortest, longest = float(length.min()), float(length.max())
    known = np.isfinite(shortest)
    Str = shortest / longest if known and np.isfinite(longest) else np.nan
    runs = known and not Str > ISOTROPIC
    return {
        "Sal": shortest if known else np.nan,
        "Str": Str,
        "Std": texture_direction(z, height_map.spacing) if runs else np.nan,
    }


def material_parameters(z: Float) -> dict[str, float]:
    """Sk Spk Svk Smr1 Smr2 Vmp Vmc Vvc Vvv of heights, nan left out."""
    curve = MaterialRatio.of(z)
    core = curve.core()
    peak, dale = VOID_AND_CORE
    Vmp, Vvv = curve.material_volume(peak), curve.void_volume(dale)
    return {
        "Sk": core.k,
        "Spk": core.pk,
        "Svk": core.vk,
        "Smr1": 100.0 * core.mr1,
        "Smr2": 100.0 * core.mr2,
        "Vmp": Vmp,
        "Vmc": curve.material_volume(dale) - Vmp,
        "Vvc": curve.void_volume(peak) - Vvv,
        "Vvv": Vvv,
    }


def undefined(parameters: dict[str, float]) -> dict[str, str]:
    """Why parameters that are nan have no value, a sentence each."""
    reasons = {
        "Sal": "the autocorrelation does not fall to 0.2 within half of the map: measure a larger "
        "field or take an L-filter",
        "Str": "the autocorrelation does not fall to 0.2 in every direction within half of the map",
        "Std": "the texture has no direction (Str above 0.5), or no structure within the map",
        "Sdq": "no cell has its neighbours: too many holes",
        "Sdr": "no cell has its neighbours: too many holes",
    }
    flat = "the surface is flat"
    return {name: reasons.get(name, flat) for name, v in parameters.items() if not np.isfinite(v)}


def parameter_unit(name: str, unit: str) -> str:
    """The unit of a parameter of a map whose lengths are in `unit`."""
    if name in LENGTHS:
        return f"{unit}^3/{unit}^2" if name.startswith("V") else unit
    return "%" if name in PERCENTAGES else "deg" if name in ANGLES else ""


def material_ratios(height_map: HeightMap, heights: Sequence[float]) -> list[float]:
    """Smr(c) in % at heights c above the mean."""
    z = height_map.z - np.nanmean(height_map.z)
    curve = MaterialRatio.of(z)
    return [100.0 * curve.at(c) for c in heights]


def inverse_material_ratios(height_map: HeightMap, ratios: Sequence[float]) -> list[float]:
    """Smc(mr): heights above the mean at material ratios in %."""
    z = height_map.z - np.nanmean(height_map.z)
    curve = MaterialRatio.of(z)
    return [curve.height(mr / 100.0) for mr in ratios]
