"""Errors of simulated series against the Cramer-Rao bound, and normalised errors."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.geometry.errors import aligned, cramer_rao
from benchmarks.geometry.series import NOISE_PX, SERIES, Series, simulate, solve
from benchmarks.tables import table
from semsfm_colmap.geometry.rotations import vector_from_rotation
from semsfm_colmap.refinement.covariance import estimate_covariance

NUM_SERIES = {60: 100, 7: 150, 5: 150, 3: 150}
"""Series a row of the table of efficiency, by number of frames."""
NOTE = (
    f"{NOISE_PX} px noise. To the bound: root mean square error over the "
    "Cramer-Rao bound at the truth, prior included, over all images and points; normalised: "
    "mean square of the errors in units of the error bars that the program gives (1: the bars "
    "are true). ± is the standard error of the benchmark itself."
)
HEAD = [
    "frames / range",
    "scale",
    "series",
    "rotation RMS deg",
    "rotation to the bound",
    "points to the bound",
    "normalised rotation²",
    "normalised points²",
]


def make(data: Path, quick: bool) -> str:
    """The table, with equal magnifications and with the prior."""
    rows = []
    for series in SERIES:
        count = 10 if quick else NUM_SERIES[series.frames]
        for known in (True, False):
            figures = np.array([efficiency(series, known, seed) for seed in range(count)])
            error2, bound2, points, rotation_square, point_square = figures.mean(axis=0)
            spread = figures.std(axis=0, ddof=1) / np.sqrt(count)
            rows.append(
                [
                    series.label,
                    "known" if known else "prior",
                    count,
                    f"{np.rad2deg(np.sqrt(error2)):.4f}",
                    f"{np.sqrt(error2 / bound2):.3f} ± "
                    f"{spread[0] / (2 * np.sqrt(error2 * bound2)):.3f}",
                    f"{np.sqrt(points):.3f} ± {spread[2] / (2 * np.sqrt(points)):.3f}",
                    f"{rotation_square:.3f} ± {spread[3]:.3f}",
                    f"{point_square:.3f} ± {spread[4]:.3f}",
                ]
            )
            print(rows[-1], flush=True)
    return f"{NOTE}\n\n{table(HEAD, rows)}"


def efficiency(series: Series, known: bool, seed: int) -> tuple[float, ...]:
    """Squared rotation error, its bound, squared points over bound, both normalised squares."""
    s = simulate(series, known, seed)
    fit = solve(s, known)
    bound = cramer_rao(s, known)
    R, T, X = aligned(fit.cameras, fit.points, s.cameras.select(fit.images))
    R_true = np.asarray(s.cameras.cam_from_world)[fit.images]
    w = vector_from_rotation(R @ R_true.mT)
    d = X - np.asarray(s.points)[fit.tracks]
    weight = 1.0 / np.trace(bound.points[fit.tracks], axis1=1, axis2=2)
    end = fit.adjustment
    own = estimate_covariance(end.model, end.state, fit.observations, fit.sigma_px).value
    assert own is not None
    # the error bars are of rotations about the camera's axes in the program's hand; squares of the
    # components do not change with it
    C = T.T @ own.points @ T
    return (
        float(np.mean(np.sum(w * w, axis=1))),
        float(np.mean(np.sum(bound.sigma_rotation_rad[fit.images] ** 2, axis=1))),
        float(np.mean(weight * np.sum(d * d, axis=1))),
        float(np.mean((w / own.sigma_rotation_rad) ** 2)),
        float(np.mean(np.einsum("ni,nij,nj->n", d, np.linalg.inv(C), d)) / 3.0),
    )
