"""The factors of the cues, and whether the confidence that they give is honest."""

from __future__ import annotations

import itertools

import numpy as np

from benchmarks.depth_sign.scenes import KINDS, Row
from benchmarks.tables import table
from semsfm_colmap.refinement.depth_reversal import visibility as in_use
from semsfm_colmap.refinement.depth_reversal.cue import CONVEX_CUES, CONVEX_MAX_LOGIT, MAX_LOGIT
from semsfm_colmap.types import Float

MIN_CONFIDENCE = 0.95
BINS = (0.5, 0.8, 0.95, 0.99, 0.999, 1.0)
RELIABILITY_HEAD = (
    "confidence",
    "scenes",
    "mean confidence",
    "right",
    "share right",
    "chance of so few",
)
KIND_HEAD = ("specimen", "range", "scenes", "resolved, right", "ambiguous", "resolved, wrong")


def fit(rows: list[Row]) -> dict[str, float]:
    """Log odds per t of each cue by maximum likelihood.

    Those that take the body to be convex are bounded together, as in use. A prior of one scene in
    which each cue was wrong at t = 4 keeps the factors finite where no
    training scene contradicts a cue.
    """
    from scipy.optimize import minimize

    names = list(in_use.CUES)
    t = np.array([[r.t.get(name, 0.0) for name in names] for r in rows]).reshape(-1, len(names))
    convex = np.array([name in CONVEX_CUES for name in names])
    counts = np.where(convex, np.array([r.body for r in rows], dtype=bool)[:, None], True)

    def cost(w: Float) -> float:
        logit = np.where(counts, np.clip(w * t, -MAX_LOGIT, MAX_LOGIT), 0.0)
        total = np.clip(logit[:, convex].sum(axis=1), -CONVEX_MAX_LOGIT, CONVEX_MAX_LOGIT)
        total += logit[:, ~convex].sum(axis=1)
        prior = np.logaddexp(0.0, 4.0 * np.asarray(w)).sum()
        return float(np.logaddexp(0.0, -total).sum() + prior)

    best = minimize(
        cost,
        [0.5] * len(names),
        method="Nelder-Mead",
        bounds=[(0.0, 3.0)] * len(names),
        options={"maxiter": 2000},
    )
    return dict(zip(names, best.x.tolist(), strict=True))


def reliability(rows: list[Row], with_tilt: bool) -> str:
    """Of the scenes with a confidence within each bin, how many have the right hand."""
    total = np.array([r.total(with_tilt) for r in rows])
    confidence = 1.0 / (1.0 + np.exp(-np.abs(total)))
    lines: list[list[str | int]] = []
    for low, high in itertools.pairwise(BINS):
        inside = (confidence >= low) & (confidence < high) & (total != 0.0)
        n, right = int(inside.sum()), int((total[inside] > 0).sum())
        said = f"{confidence[inside].mean():.4f}" if n else "-"
        share = f"{right / n:.3f}" if n else "-"
        chance = f"{chance_of_at_most(right, confidence[inside]):.2f}" if n else "-"
        lines.append([f"{low} to {high}", n, said, right, share, chance])
    lines.append(["no evidence", int((total == 0).sum()), "0.5", "-", "-", "-"])
    return table(RELIABILITY_HEAD, lines)


def chance_of_at_most(right: int, probability: Float) -> float:
    """Chance of at most so many right ones if each is right with the probability it claims.

    Near zero the confidence claims too much; the exact distribution of a sum of unlike coins.
    """
    distribution = np.ones(1)
    for p in probability:
        distribution = np.convolve(distribution, [1.0 - p, p])
    return float(distribution[: right + 1].sum())


def by_kind(rows: list[Row], with_tilt: bool) -> str:
    """Resolved right, resolved wrong, ambiguous: by kind and range."""
    bound = np.log(MIN_CONFIDENCE / (1.0 - MIN_CONFIDENCE))
    lines: list[list[str | int]] = []
    for kind in dict.fromkeys(KINDS.values()):
        for low, high in ((10, 30), (30, 90), (90, 361)):
            total = np.array(
                [r.total(with_tilt) for r in rows if r.kind == kind and low <= r.range_deg < high]
            )
            if len(total) == 0:
                continue
            right, wrong = int((total >= bound).sum()), int((total <= -bound).sum())
            label = f"{low} to {min(high, 360)}°"
            lines.append([kind, label, len(total), right, len(total) - right - wrong, wrong])
    return table(KIND_HEAD, lines)
