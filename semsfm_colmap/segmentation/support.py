r"""A coil or a stalk that leaves the images on one side, told from the specimen that it carries.

Let g be the direction of that side (`contact`), s = x . g the position along it. From the border
inward the support has a cross-section that hardly changes. Its axis is the line a(s) = a_0 + a_1 s
that, with a radius R, minimises the robust sum of ``|x - a(s)| - R`` across g; with
r = |x - a(s)|, the profile rho(s), the 95th percentile of r in a slice, tells where it ends:
the first slice beyond which rho exceeds `widening` times its median so far is the **neck**. What
lies between border and neck is support, what lies beyond and outside of that cylinder is specimen.

Between them, beyond the neck and within the cylinder, the support may go on among parts of the
specimen (a ribbon between spores). There each point is judged by cues whose distributions
are those of the support before the neck against those of the specimen outside the cylinder:

- r, against points that fill the disc evenly, p(r) = 2 r / R_max^2;
- c = |n . radial|, against normals without preference, which are uniform in c;
- the logarithm of the roughness, against that of the specimen;
- where the support is a helix, the phase ``psi = phi - 2 pi s / P`` of the angle phi about the
  axis, against phases without preference. The pitch P, of either hand, is the one that maximises
  ``|mean exp(i psi)|`` over the support before the neck; a ribbon that covers the share q of a turn
  has ``sin(pi q) / (pi q)`` there, a round stalk nothing, and then the cue is left out.

The sum of the log-likelihood ratios, bounded, is the prior of the random walker (`walker`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from semsfm_colmap.segmentation.options import SegmentationOptions
from semsfm_colmap.types import Bool, Float

SLICE_SPACINGS = 3.0
"""Length of a slice, in spacings of the cloud."""
PROFILE_PERCENTILE = 95.0
MIN_SLICE_POINTS = 10
NUM_BINS = 24
MAX_LOG_ODDS = 6.0
"""Bound on what the cues together say: 1 in 400."""
MIN_LENGTH_RADII = 0.6
"""A support is at least this long, in its own radii: shorter is a body cut by the frame."""
LASTING_SLICES = 3
"""A widening lasts for this many slices."""
MAX_HELIX_POINTS = 4000
MIN_PITCH_RADII = 0.4
"""Shortest pitch that is looked for, in radii of the support."""
MIN_TURNS = 1.0
"""A helix is told from a bent rod when the support shows at least one turn of it."""
MIN_HELIX_STRENGTH = 0.2
"""Between round stalks seen from one side, up to 0.14, and ribbons whose gaps a coarse stereo
bridges, 0.26 and more; one that covers half of a turn has 0.64."""
START_SLICES = 3
"""Slices at the border that the first axis is fitted to."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Support:
    """A support, in the coordinates of N points."""

    held: Bool
    """(N,) before the neck, within the cylinder: support without doubt"""
    carried: Bool
    """(N,) beyond the neck and outside the cylinder: specimen without doubt"""
    along: Float
    """(N,) s, growing toward the border"""
    radius: Float
    """(N,) distance from the axis of the support"""
    cosine: Float
    """(N,) |n . radial|"""
    phase: Float | None
    """(N,) of the helix, as a share of a turn; None where the support is none"""
    limit: float
    """radius of the cylinder that holds the support"""
    neck: float
    """s of the neck"""


def find_support(
    points: Float,
    normals: Float,
    touches: Bool,
    direction: Float,
    spacing: float,
    options: SegmentationOptions,
) -> Support | None:
    """The support that leaves on one side; None where nothing wider hangs on it.

    Parameters
    ----------
    points, normals : (N, 3)
    touches : (N,) points that touch that side of the frame
    direction : (3,) its outward normal in the world
    spacing : of the points, world units

    """
    g = direction / np.linalg.norm(direction)
    e = np.linalg.svd(g[None])[2][1:]
    s, across = points @ g, points @ e.T
    step = SLICE_SPACINGS * spacing
    # slices from the border inward; beyond the contact zone the frame cuts some views, not all
    end = float(np.percentile(s[touches], 50))
    number = np.floor((end - s) / step).astype(np.int64)
    last = int(number.max())
    stop = START_SLICES
    axis = fit_axis_line(s[touches | (number < stop)], across[touches | (number < stop)])
    limit = 0.0
    while stop <= last:
        r = _radius(s, across, axis)
        profile = np.array([_percentile(r[number == k]) for k in range(last + 1)])
        known = profile[:stop][np.isfinite(profile[:stop])]
        limit = options.widening * float(np.median(known)) if len(known) else 0.0
        wide = profile > limit
        neck = next(
            (k for k in range(last + 1) if wide[k : k + LASTING_SLICES].all()),
            last + 1,
        )
        if neck <= stop:
            break
        stop = min(neck, 2 * stop)
        axis = fit_axis_line(s[number < stop], across[number < stop])
        if stop == neck:
            break
    r = _radius(s, across, axis)
    at = end - neck * step
    if neck > last or float(np.percentile(s[touches], 98)) - at < MIN_LENGTH_RADII * limit:
        return None
    radial = (across - axis[:2] - s[:, None] * axis[2:4]) / np.maximum(r, 1e-300)[:, None]
    held = (s > at) & (r <= limit)
    return Support(
        held=held,
        carried=(s <= at) & (r > limit),
        along=s,
        radius=r,
        cosine=np.abs(np.einsum("ni,ni->n", normals @ e.T, radial)),
        phase=_helix_phase(s, across - axis[:2] - s[:, None] * axis[2:4], held, limit),
        limit=limit,
        neck=at,
    )


def fit_axis_line(s: Float, across: Float) -> Float:
    """``(a_0, a_1, R)``, 5 numbers, that minimise the robust sum of ``|y - a_0 - a_1 s| - R``."""
    from scipy.optimize import least_squares

    if len(s) > 20_000:
        rows = np.linspace(0, len(s) - 1, 20_000).astype(np.int64)
        s, across = s[rows], across[rows]
    middle = across.mean(axis=0)
    radius = float(np.median(np.linalg.norm(across - middle, axis=1)))
    origin = float(s.mean())

    def gap(q: Float) -> Float:
        away = across - q[:2] - (s - origin)[:, None] * q[2:4]
        return np.asarray(np.linalg.norm(away, axis=1) - q[4])

    start = np.array([*middle, 0.0, 0.0, radius])
    q = least_squares(gap, start, loss="soft_l1", f_scale=0.1 * radius + 1e-300).x
    return np.array([*(q[:2] - origin * q[2:4]), *q[2:]])


def log_odds(support: Support, roughness: Float) -> Float:
    """What the cues say for support against specimen: (N,), within +-`MAX_LOG_ODDS`."""
    held, carried, limit = support.held, support.carried, support.limit
    share = np.clip(support.radius / limit, 0.0, 1.0)
    edges = np.linspace(0.0, 1.0, NUM_BINS + 1)
    odds = _ratio(share, share[held], edges, np.diff(edges**2))
    odds += _ratio(support.cosine, support.cosine[held], edges, np.diff(edges))
    if support.phase is not None:
        odds += _ratio(support.phase, support.phase[held], edges, np.diff(edges))
    log_rough = np.log(np.maximum(roughness, 1e-9))
    known = log_rough[held | carried]
    edges = np.unique(np.quantile(known, np.linspace(0.0, 1.0, NUM_BINS + 1)))
    if len(edges) > 2:
        other = np.histogram(log_rough[carried], bins=edges)[0] + 1.0
        odds += _ratio(log_rough, log_rough[held], edges, other / other.sum())
    return np.clip(odds, -MAX_LOG_ODDS, MAX_LOG_ODDS)


def _helix_phase(s: Float, away: Float, held: Bool, limit: float) -> Float | None:
    """Phase of every point on the helix that the support is, 0 to 1; None where it is none."""
    angle = np.arctan2(away[:, 1], away[:, 0])
    rows = np.flatnonzero(held)
    rows = rows[np.linspace(0, len(rows) - 1, min(len(rows), MAX_HELIX_POINTS)).astype(np.int64)]
    length = float(np.ptp(s[rows]))
    if length <= 0.0:
        return None
    # a change of 1 / (8 length) turns the last point by an eighth of a turn against the first
    most = 1.0 / (MIN_PITCH_RADII * limit)
    turns = np.arange(-most, most, 0.125 / length)
    turns = turns[np.abs(turns) >= MIN_TURNS / length]
    if len(turns) == 0:
        return None
    turned = np.exp(1j * (angle[rows, None] - 2.0 * np.pi * s[rows, None] * turns))
    strength = np.abs(turned.mean(axis=0))
    best = int(strength.argmax())
    if strength[best] < MIN_HELIX_STRENGTH:
        return None
    return np.asarray((angle / (2.0 * np.pi) - s * turns[best]) % 1.0)


def _ratio(value: Float, sample: Float, edges: Float, other: Float) -> Float:
    """Logarithm of a histogram of `sample` over the shares `other`, looked up at `value`."""
    count = np.histogram(np.clip(sample, edges[0], edges[-1]), bins=edges)[0] + 1.0
    bin_ = np.clip(np.searchsorted(edges, value, side="right") - 1, 0, len(edges) - 2)
    return np.asarray(np.log(count / count.sum() / other)[bin_])


def _radius(s: Float, across: Float, axis: Float) -> Float:
    return np.asarray(np.linalg.norm(across - axis[:2] - s[:, None] * axis[2:4], axis=1))


def _percentile(r: Float) -> float:
    """Profile of a slice; nan, which is not wide, where it holds too little."""
    if len(r) < MIN_SLICE_POINTS:
        return float("nan")
    return float(np.percentile(r, PROFILE_PERCENTILE))
