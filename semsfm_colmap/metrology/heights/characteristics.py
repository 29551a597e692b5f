"""Metrological characteristics of a series in the sense of ISO 25178-600.

Each one is measured, or said to be "not assessed": nothing is assumed.

- N_M, measurement noise, from two halves of the frames, which share no pixel: Sq of the difference
  of their S-filtered heights over root 2;
- z_FLT, flatness deviation, from a truth: max - min of the S-filtered difference;
- alpha_z and l_z, amplification and linearity, from a truth or known steps: slope of the response
  curve and largest deviation from the line;
- D_LIM, lateral period limit, from a truth: the period that half of the amplitude is left of.

The halves also tell the shortest period that both have alike: the Fourier ring correlation

    FRC(f) = Re sum F_1 F_2^* / sqrt(sum |F_1|^2 sum |F_2|^2)

over the rings of frequency f falls below 1/2 there. Windows average both halves alike, so that this
is a bound from below on the lateral period limit, and no measure of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import fft
from scipy.interpolate import LinearNDInterpolator
from scipy.optimize import minimize_scalar
from scipy.spatial import Delaunay

from semsfm_colmap.errors import InputError
from semsfm_colmap.metrology.heights.filters import gaussian
from semsfm_colmap.metrology.heights.height_map import HeightMap
from semsfm_colmap.metrology.heights.scale_limited import Filtering, Transfer, scale_limited
from semsfm_colmap.types import Float

NOT_ASSESSED = "not assessed"
AGREEMENT = 0.5
"""Correlation of a ring at which the halves agree no more."""
NUM_RESPONSES = 20
"""Heights, as equally filled classes, at which the response curve is sampled."""
LONGEST_EDGE = 4.0
"""Triangles between points of a cloud with longer edges, in cells, span holes."""
MAX_TRANSFER_CELLS = 60.0
MIN_SHARED_CELLS = 400


@dataclass(frozen=True, kw_only=True)
class Characteristic:
    """One characteristic; `value` is None where it was not assessed."""

    symbol: str
    name: str
    value: float | None
    unit: str
    how: str
    """what it was measured from, or why it was not"""


def noise(halves: tuple[HeightMap, HeightMap] | None, filtering: Filtering) -> Characteristic:
    """N_M of a series with half of the frames: Sq of the halves' difference over root 2."""
    symbol, name = "N_M", "measurement noise of half of the frames"
    if halves is None:
        how = f"{NOT_ASSESSED}: run densify with --surface.half_series"
        return Characteristic(symbol=symbol, name=name, value=None, unit="", how=how)
    difference = halves[0].with_heights(halves[0].z - halves[1].z)
    Sq = float(np.nanstd(scale_limited(difference, filtering).z))
    how = "Sq of the S-filtered difference of odd and even frames over root 2; all frames have less"
    return Characteristic(
        symbol=symbol, name=name, value=Sq / np.sqrt(2.0), unit=halves[0].unit, how=how
    )


def agreed_period(halves: tuple[HeightMap, HeightMap] | None) -> Characteristic:
    """The shortest period that the halves have alike."""
    symbol, name = "FRC 1/2", "shortest period that odd and even frames have alike"
    if halves is None:
        how = f"{NOT_ASSESSED}: run densify with --surface.half_series"
        return Characteristic(symbol=symbol, name=name, value=None, unit="", how=how)
    frequency, correlation = ring_correlation(*halves)
    below = np.flatnonzero(correlation < AGREEMENT)
    shortest = 1.0 / float(frequency[below[0]] if len(below) else frequency[-1])
    how = (
        "Fourier ring correlation of 1/2; windows average both alike: a bound from below on the "
        "lateral period limit, no measure of it"
    )
    return Characteristic(symbol=symbol, name=name, value=shortest, unit=halves[0].unit, how=how)


def ring_correlation(one: HeightMap, other: HeightMap) -> tuple[Float, Float]:
    """Frequencies of the rings and the correlation of two maps on one grid in each: (K,) both.

    Under a Hann window, cells that either lacks at 0.
    """
    both = one.measured & other.measured
    if both.sum() < MIN_SHARED_CELLS:
        raise InputError(f"The two height maps share {both.sum()} cells only: nothing to compare.")
    window = np.outer(np.hanning(both.shape[0]), np.hanning(both.shape[1]))
    a, b = (fft.fft2(np.where(both, m.z - np.mean(m.z[both]), 0.0) * window) for m in (one, other))
    fy = fft.fftfreq(both.shape[0], one.spacing[1])[:, None]
    fx = fft.fftfreq(both.shape[1], one.spacing[0])[None]
    step = 1.0 / max(one.size)
    ring = np.rint(np.hypot(fx, fy) / step).astype(int)
    num = int(0.5 / max(one.spacing) / step)

    def summed(values: Float) -> Float:
        total = np.bincount(ring.ravel(), values.ravel(), minlength=num + 1)[1 : num + 1]
        return np.asarray(total, dtype=np.float64)

    cross = summed((a * np.conj(b)).real)
    power = summed(np.abs(a) ** 2) * summed(np.abs(b) ** 2)
    frequency = step * np.arange(1.0, num + 1.0)
    return frequency, np.asarray(cross / np.sqrt(np.maximum(power, 1e-300)))


def amplification(
    measured: HeightMap | None, truth: HeightMap | None, steps: Sequence[tuple[float, float]] = ()
) -> tuple[Characteristic, Characteristic]:
    """alpha_z and l_z from two maps on one grid, equally filtered, or from (known, measured) steps.

    The response curve of the maps are the mean measured heights of twenty classes of true ones.
    """
    what = (("alpha_z", "amplification coefficient"), ("l_z", "linearity deviation"))
    if measured is not None and truth is not None:
        both = measured.measured & truth.measured
        order = np.argsort(truth.z[both])
        classes = np.array_split(order, NUM_RESPONSES)
        known = np.array([truth.z[both][c].mean() for c in classes])
        seen = np.array([measured.z[both][c].mean() for c in classes])
        how, unit = "response curve against the truth", str(measured.unit)
    elif len(steps) >= 2:
        known, seen = np.array(steps, dtype=np.float64).T
        how, unit = f"{len(steps)} known steps", ""
    else:
        how = f"{NOT_ASSESSED}: no truth and no two known steps"
        first, second = (
            Characteristic(symbol=s, name=n, value=None, unit="", how=how) for s, n in what
        )
        return first, second
    slope, offset = np.polyfit(known, seen, 1)
    largest = float(np.abs(seen - slope * known - offset).max())
    return (
        Characteristic(symbol="alpha_z", name=what[0][1], value=float(slope), unit="", how=how),
        Characteristic(symbol="l_z", name=what[1][1], value=largest, unit=unit, how=how),
    )


def flatness(measured: HeightMap | None, truth: HeightMap | None) -> Characteristic:
    """z_FLT: max - min of what two maps on one grid, equally filtered, differ by."""
    symbol, name = "z_FLT", "flatness deviation"
    if measured is None or truth is None:
        how = f"{NOT_ASSESSED}: no truth and no flat specimen"
        return Characteristic(symbol=symbol, name=name, value=None, unit="", how=how)
    difference = (measured.z - truth.z)[measured.measured & truth.measured]
    return Characteristic(
        symbol=symbol,
        name=name,
        value=float(np.ptp(difference)),
        unit=measured.unit,
        how="difference to the truth, S-filtered",
    )


def lateral_period_limit(measured: HeightMap | None, truth: HeightMap | None) -> Characteristic:
    """D_LIM: the nesting index of the Gaussian filter that takes a truth to the measured heights.

    Both are unfiltered maps on one grid. It is the period of which half of the amplitude is left.
    """
    symbol, name = "D_LIM", "lateral period limit"
    if measured is None or truth is None:
        how = f"{NOT_ASSESSED}: no truth"
        return Characteristic(symbol=symbol, name=name, value=None, unit="", how=how)
    return Characteristic(
        symbol=symbol,
        name=name,
        value=fitted_transfer(measured, truth),
        unit=measured.unit,
        how="Gaussian filter that takes the truth nearest to the measured heights",
    )


def fitted_transfer(measured: HeightMap, truth: HeightMap) -> float:
    """The T that minimises the RMS of ``measured - (truth behind a Gaussian filter of T)``."""
    both = measured.measured & truth.measured
    dx, dy = measured.spacing
    z = np.where(both, truth.z, np.nan)

    def misfit(index: float) -> float:
        away = measured.z[both] - gaussian(z, (dy, dx), index)[both]
        return float(np.std(away))

    low, high = 2.01 * max(dx, dy), MAX_TRANSFER_CELLS * max(dx, dy)
    return float(minimize_scalar(misfit, bounds=(low, high), method="bounded").x)


def characteristics(
    measured: HeightMap,
    filtering: Filtering,
    transfer: Transfer,
    *,
    halves: tuple[HeightMap, HeightMap] | None = None,
    truth: HeightMap | None = None,
    steps: Sequence[tuple[float, float]] = (),
) -> list[Characteristic]:
    """All of the table above; maps are unfiltered, `halves` and `truth` on the grid of `measured`.

    Parameters
    ----------
    filtering : what noise, flatness and amplification are measured behind
    steps : (known, measured) heights

    """
    with_truth = truth is not None
    behind = scale_limited(measured, filtering, transfer) if with_truth else None
    known = scale_limited(truth, filtering) if truth is not None else None
    return [
        noise(halves, filtering),
        flatness(behind, known),
        *amplification(behind, known, steps),
        lateral_period_limit(measured if with_truth else None, truth),
        agreed_period(halves),
    ]


def height_map_of_points(points: Float, like: HeightMap) -> HeightMap:
    """Heights of a cloud on the grid of a map: planes through neighbours, long ones left out.

    Parameters
    ----------
    points : (N, 3) in the world of `like`

    """
    assert like.origin is not None
    assert like.axes is not None
    local = (points - like.origin) @ like.axes.T / [*like.spacing, 1.0]
    if len(local) < 3:
        raise InputError(f"The cloud has {len(local)} points: there is no surface through them.")
    plane = Delaunay(local[:, :2])
    edge = local[plane.simplices][:, :, :2] - np.roll(local[plane.simplices][:, :, :2], 1, axis=1)
    wide = np.linalg.norm(edge, axis=2).max(axis=1) > LONGEST_EDGE
    rows, columns = like.z.shape
    x, y = np.meshgrid(np.arange(columns, dtype=float), np.arange(rows, dtype=float))
    at = np.stack([x, y], axis=-1)
    z = LinearNDInterpolator(plane, local[:, 2])(at)
    inside = plane.find_simplex(at)
    z[(inside < 0) | wide[inside]] = np.nan
    return HeightMap(z=z, spacing=like.spacing, unit=like.unit, origin=like.origin, axes=like.axes)
