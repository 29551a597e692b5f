r"""What an actuator or a stage reads against the angles that the images show.

The angle of image i is modelled as

    phi_i = f x_i + c + (h / 2) d_i + e_i,

x the read-out, f the conversion, d = +1 where the read-out was rising and -1 where it was falling,
h the hysteresis (left out where the read-out runs one way only). The fit is Huber's [Huber 1964],
by iteratively reweighted least squares, so that no single read-out bends it. With L the linear
estimator at the last weights, C the joint covariance of the angles and s^2 the variance by which
the residuals exceed what C explains,

    cov(f, c, h) = L (C + s^2 I) L^T:

the angles err together, and what they err in together is mostly a stretch of all of them, which no
residual shows. Whether the relation is straight is asked with one more column, the square of x.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from semsfm_colmap.geometry import losses
from semsfm_colmap.geometry.losses import MAD_TO_SIGMA
from semsfm_colmap.geometry.rotations import wrapped
from semsfm_colmap.types import Bool, Float, Int

MAX_ITERATIONS = 50
OUTLIER_SIGMAS = 4.0
"""Residuals beyond so many robust standard deviations are named: one Gaussian in 16,000."""
MIN_READOUTS = 5
"""A line with a scatter of its own: fewer say nothing about the scatter."""
MIN_FRAMES_OF_A_RUN = 2
"""Fewer frames one way than this give no hysteresis."""
REVERSAL = 0.5
"""The read-out has turned when it comes back by this part of its median step."""
BENT_SIGMAS = 3.0
"""A bend is a finding beyond so many standard deviations."""
EXACT_RAD = 1e-9
"""Floor of the scatter: the rounding noise of a rotation."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ReadoutLine:
    """The line through K angles against their read-outs; angles in radians."""

    slope: float
    """f, rad per unit of the read-out"""
    slope_sigma: float
    offset_rad: float
    """c, the angle at a read-out of zero"""
    hysteresis_rad: float | None
    """h, rising minus falling; None where the read-out runs one way only"""
    hysteresis_sigma_rad: float | None
    angle_rad: Float
    """(K,) as given, with whole turns as the line has them"""
    residual_rad: Float
    """(K,) seen minus line"""
    scatter_rad: float
    """standard deviation of the residuals, those far out left aside"""
    bend_rad: float
    """largest departure from the line, over the range of the read-out, by the square of x"""
    bend_sigma_rad: float

    @property
    def outlier(self) -> Bool:
        """(K,) read-outs that do not fit the others."""
        return np.abs(self.residual_rad) > OUTLIER_SIGMAS * max(self.scatter_rad, EXACT_RAD)

    @property
    def is_straight(self) -> bool:
        """False when the images contradict a straight line."""
        return abs(self.bend_rad) <= BENT_SIGMAS * self.bend_sigma_rad


def run_direction(readout: Float) -> Int:
    """Which way the read-out went at each image: (K,) +1 rising, -1 falling.

    A turning point counts where the read-out comes back by more than half its median step; the
    image at a turning point belongs to the run that leads there, the first one to the first run.

    Examples
    --------
    >>> run_direction(np.array([0.0, 1.0, 2.0, 1.1, 0.1]))
    array([ 1,  1,  1, -1, -1])

    """
    x = np.asarray(readout, dtype=np.float64)
    steps = np.abs(np.diff(x))
    threshold = REVERSAL * float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
    turns, way, extreme = [0], 0, 0
    for k in range(1, len(x)):
        if way == 0:
            if abs(x[k] - x[0]) > threshold:
                way, extreme = int(np.sign(x[k] - x[0])), k
        elif way * (x[k] - x[extreme]) >= 0.0:
            extreme = k
        elif way * (x[extreme] - x[k]) > threshold:
            turns.append(extreme)
            way, extreme = -way, k
    number = np.searchsorted(np.array(turns[1:], dtype=np.int64), np.arange(len(x)), side="left")
    last_run = len(turns) - 1
    return np.asarray((way or 1) * (-1) ** (last_run - number), dtype=np.int64)


def follow_readout(angle_rad: Float, readout: Float) -> Float:
    """Angles (K,) with whole turns chosen so that they follow the read-out, whatever the order.

    Neighbours in the read-out are taken to be less than half a turn apart.
    """
    order = np.argsort(readout, kind="stable")
    followed = np.empty(len(angle_rad))
    followed[order] = np.unwrap(np.asarray(angle_rad)[order])
    return followed


def fit_readout(
    readout: Float, angle_rad: Float, covariance: Float | None = None
) -> ReadoutLine | None:
    """The robust line of angles (K,) against read-outs (K,), in the order of acquisition.

    None for fewer than `MIN_READOUTS` images, or where the read-outs do not differ.

    Parameters
    ----------
    angle_rad : whole turns chosen, see `follow_readout`; they are corrected by the line itself
    covariance : (K, K) of the angles in rad^2, None where none is known

    """
    x, y = np.asarray(readout, dtype=np.float64), np.array(angle_rad, dtype=np.float64)
    if len(x) < MIN_READOUTS or np.ptp(x) <= 0.0:
        return None
    C = np.zeros((len(x), len(x))) if covariance is None else covariance
    way = run_direction(x)
    both_ways = min(np.sum(way > 0), np.sum(way < 0)) >= MIN_FRAMES_OF_A_RUN
    middle = 0.5 * (x.max() + x.min())
    half = 0.5 * float(np.ptp(x))
    columns = [(x - middle) / half, np.ones(len(x))]
    if both_ways:
        columns.append(0.5 * way)
    A = np.stack(columns, axis=1)
    fit = _fit(A, y, C)
    residual = -wrapped(A @ fit.beta - y)
    if np.any(np.abs(residual - (y - A @ fit.beta)) > math.pi):
        # a frame that does not follow the others was a turn off
        y = A @ fit.beta + residual
        fit = _fit(A, y, C)
    bent = _fit(np.column_stack([A, ((x - middle) / half) ** 2]), y, C)
    sigma = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    slope = float(fit.beta[0]) / half
    return ReadoutLine(
        slope=slope,
        slope_sigma=float(sigma[0]) / half,
        offset_rad=float(fit.beta[1]) - slope * middle,
        hysteresis_rad=float(fit.beta[2]) if both_ways else None,
        hysteresis_sigma_rad=float(sigma[2]) if both_ways else None,
        angle_rad=y,
        residual_rad=y - A @ fit.beta,
        scatter_rad=fit.scatter,
        # a parabola departs from its chord by the coefficient of the square on [-1, 1]
        bend_rad=float(bent.beta[-1]),
        bend_sigma_rad=float(np.sqrt(max(bent.covariance[-1, -1], 0.0))),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Fit:
    beta: Float
    covariance: Float
    scatter: float


def _fit(A: Float, y: Float, C: Float) -> _Fit:
    """Huber's fit of ``A beta`` to y (K,), with errors of covariance C and a scatter of their own.

    Parameters
    ----------
    A : (K, p)
    C : (K, K)

    """
    K, p = A.shape
    weight = np.ones(K)
    for _ in range(MAX_ITERATIONS):
        L = np.linalg.solve((A.T * weight) @ A, A.T * weight)
        r = y - A @ (L @ y)
        width = MAD_TO_SIGMA * float(np.median(np.abs(r))) * math.sqrt(K / (K - p))
        before = weight
        weight = losses.weight("huber", (r / max(width, EXACT_RAD)) ** 2, losses.HUBER_TUNING)
        if np.max(np.abs(weight - before)) < 1e-6:
            break
    # the median only says which residuals are those of the bulk: their mean square is steadier
    bulk = r[np.abs(r) <= OUTLIER_SIGMAS * max(width, EXACT_RAD)]
    scatter = float(np.sqrt(np.sum(bulk**2) / max(len(bulk) - p, 1)))
    left = np.eye(K) - A @ L
    explained = float(np.sum((left @ C) * left)) / (K - p)
    own = max(scatter**2 - explained, 0.0)
    covariance = L @ (C + own * np.eye(K)) @ L.T
    return _Fit(beta=L @ y, covariance=covariance, scatter=scatter)
