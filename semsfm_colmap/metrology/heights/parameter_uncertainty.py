"""Standard uncertainty of parameters of a height map, source by source.

The error bars of a surface are of its heights against the true surface, relief that windows average
away included. Of a parameter at a stated S-nesting index that is taken apart:

- noise (kind A): what is left of the errors at this nesting index and is not the transfer below.
  Monte Carlo: fields ``share * sigma_z * g`` are added to the map, g of unit variance, white noise
  behind the filter that the reconstruction itself is (T). The standard deviation of the parameter
  counts. The mean shift is what noise adds (in quadrature, to Sq) and the map has already, but
  errors that averaging makes take as much away: it is the half width of a uniform distribution, an
  error of kind B of its own;
- transfer (B): the nesting index T of the reconstruction, one standard deviation up and down;
- amplification (B): heights in proportion, e.g. from the total rotation;
- scale (B): all lengths in proportion, from the pixel size.

They are independent: the combined standard uncertainty is the root of the sum of the squares.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np

from semsfm_colmap.metrology.heights.areal import ANGLES, LENGTHS
from semsfm_colmap.metrology.heights.filters import gaussian, kernel
from semsfm_colmap.metrology.heights.height_map import HeightMap
from semsfm_colmap.metrology.heights.scale_limited import Filtering, Transfer, scale_limited
from semsfm_colmap.types import Float

Parameters = Callable[[HeightMap], dict[str, float]]
SOURCES = {"noise": "A", "noise bias": "B", "transfer": "B", "amplification": "B", "scale": "B"}
"""Sources and their kind in the sense of the GUM."""
UNIFORM = float(np.sqrt(3.0))
"""Half width of a uniform distribution over its standard deviation."""
COVERAGE = 1.96
"""Standard deviations of an interval that holds 95 %."""
MAX_TRANSFER = 0.98
"""Largest T in units of the S-nesting index: beyond there is no filter left to vary."""
NOISE_SHARE = 0.9
"""Part of sigma that is left beside the transfer, chosen on rendered fields."""
HALF_TURN = 180.0


@dataclass(frozen=True, kw_only=True)
class ErrorModel:
    """What is known about the errors of a height map."""

    transfer: Transfer
    """of the reconstruction, by which its errors are correlated too"""
    noise_share: float = NOISE_SHARE
    """of the map's sigma"""
    amplification_sigma: float | None = None
    """relative, of heights; None: not assessed"""
    scale_sigma: float | None = None
    """relative, of all lengths; None: not assessed"""


@dataclass(frozen=True, kw_only=True)
class MeasuredParameter:
    """A parameter with its uncertainty budget."""

    value: float
    sigma: float
    """combined standard uncertainty; nan where the value is"""
    sources: Mapping[str, float | None]
    """standard uncertainty by source; None: not assessed"""

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval."""
        return self.value - COVERAGE * self.sigma, self.value + COVERAGE * self.sigma


def measured_parameters(
    height_map: HeightMap,
    filtering: Filtering,
    model: ErrorModel,
    parameters: Parameters,
    rng: np.random.Generator,
    *,
    lengths: Collection[str] = LENGTHS,
    num_draws: int = 30,
) -> dict[str, MeasuredParameter]:
    """Parameters of the scale-limited surface of a map, each with its uncertainty.

    Parameters
    ----------
    height_map : before any filter, with sigma
    parameters : of a scale-limited surface, e.g. `areal_parameters`
    lengths : names of those that are in proportion to the scale
    num_draws : of the Monte Carlo: the uncertainty is itself known to ``1 / sqrt(2 num_draws)``

    """

    def evaluated(of: HeightMap, transfer: Transfer = model.transfer) -> dict[str, float]:
        return parameters(scale_limited(of, filtering, transfer))

    value = evaluated(height_map)
    names = list(value)
    centre = np.array([value[name] for name in names])

    def differences(found: dict[str, float]) -> Float:
        away = np.array([found[name] for name in names]) - centre
        turns = np.isin(names, ANGLES)
        # directions of a texture repeat after half a turn
        away[turns] = (away[turns] + HALF_TURN / 2.0) % HALF_TURN - HALF_TURN / 2.0
        return away

    parts: dict[str, Float | None] = dict.fromkeys(SOURCES)
    if height_map.sigma is not None:
        draws = [
            differences(evaluated(disturbed(height_map, model, rng))) for _ in range(num_draws)
        ]
        spread = np.array(draws)
        parts["noise"] = np.std(spread, axis=0, ddof=1)
        parts["noise bias"] = np.abs(np.mean(spread, axis=0)) / UNIFORM
    T, u = model.transfer.nesting_index, model.transfer.sigma
    if filtering.s_index is not None and u > 0.0:
        most = MAX_TRANSFER * filtering.s_index
        low, high = (replace(model.transfer, nesting_index=min(t, most)) for t in (T - u, T + u))
        both = differences(evaluated(height_map, high)) - differences(evaluated(height_map, low))
        parts["transfer"] = np.abs(both) / 2.0
    if model.amplification_sigma is not None:
        higher = height_map.with_heights(height_map.z * (1.0 + model.amplification_sigma))
        parts["amplification"] = np.abs(differences(evaluated(higher)))
    if model.scale_sigma is not None:
        scaled = np.isin(names, list(lengths))
        parts["scale"] = np.where(scaled, model.scale_sigma * np.abs(centre), 0.0)
    known = [part for part in parts.values() if part is not None]
    total = np.sqrt(sum((part**2 for part in known), np.zeros(len(names))))
    total = np.where(np.isfinite(centre), total, np.nan)
    return {
        name: MeasuredParameter(
            value=float(centre[k]),
            sigma=float(total[k]),
            sources={s: None if p is None else float(p[k]) for s, p in parts.items()},
        )
        for k, name in enumerate(names)
    }


def disturbed(height_map: HeightMap, model: ErrorModel, rng: np.random.Generator) -> HeightMap:
    """The map with one more error of the size and correlation of those it has."""
    assert height_map.sigma is not None
    field = correlated_field(height_map, model.transfer.nesting_index, rng)
    return height_map.with_heights(height_map.z + model.noise_share * height_map.sigma * field)


def correlated_field(
    height_map: HeightMap, nesting_index: float, rng: np.random.Generator
) -> Float:
    """A Gaussian field of unit variance on a map's grid: white noise behind a Gaussian filter."""
    dx, dy = height_map.spacing
    rows, columns = height_map.z.shape
    if not nesting_index > 2.0 * max(dx, dy):
        return rng.normal(size=(rows, columns))
    # a margin as wide as the filter keeps the variance up to the ends
    my, mx = (int(np.ceil(nesting_index / step)) for step in (dy, dx))
    white = rng.normal(size=(rows + 2 * my, columns + 2 * mx))
    smooth = gaussian(white, (dy, dx), nesting_index, order=0)[my : my + rows, mx : mx + columns]
    return smooth / unit_gain(nesting_index, dx) / unit_gain(nesting_index, dy)


def unit_gain(nesting_index: float, spacing: float) -> float:
    """Root of the sum of the squared weights of the filter: what it leaves of white noise."""
    return float(np.sqrt(np.sum(kernel(spacing, nesting_index)[1] ** 2)))
