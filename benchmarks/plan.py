"""`semsfm plan` against Monte Carlo: predicted standard deviations, and errors of full runs.

Specimens that the planner has not seen are simulated. In each run magnifications and scan drifts
are drawn from their priors and noise is added to the tracks, which are factorized, filtered and
bundle-adjusted with the drift as in the mapping stage. Structure and truth are laid on one another
by a rigid motion; of each point the RMS error along its normal over the runs is taken, and the
median over the points is what the planner predicts. The mean over the specimens is given.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks import tables
from semsfm_colmap.factorization.factorize import factorize, find_parts
from semsfm_colmap.factorization.options import FactorizationOptions
from semsfm_colmap.geometry.alignment import fit_similarity
from semsfm_colmap.geometry.rotations import depth_reversed, vector_from_rotation
from semsfm_colmap.planning.options import NoiseOptions, SpecimenOptions
from semsfm_colmap.planning.prediction import Geometry
from semsfm_colmap.planning.series import (
    PlannedSeries,
    SeriesSize,
    plan_series,
    planned_geometry,
)
from semsfm_colmap.refinement.adjustment import BundleSettings, last_solver
from semsfm_colmap.refinement.options import RefinementOptions
from semsfm_colmap.refinement.refine import refine
from semsfm_colmap.refinement.scan_drift import adjust_with_drift
from semsfm_colmap.types import Float, Observations

SEEDS = (7, 8, 9)
"""Of the specimens that are reconstructed; the planner's is 0."""
NUM_POINTS = 300
HEAD = (
    "series",
    "noise px",
    "runs of 3 specimens",
    "depth sigma px: predicted",
    "measured",
    "ratio",
    "rotation sigma deg: predicted",
    "measured",
    "ratio",
)


@dataclass(frozen=True, kw_only=True)
class SetUp:
    """A series to be taken of a specimen."""

    specimen: SpecimenOptions
    size: SeriesSize
    noise: NoiseOptions

    @property
    def name(self) -> str:
        """As it stands in the table."""
        return (
            f"{self.specimen.specimen}, {self.size.num_frames} images, {self.size.total_deg:g} deg"
        )


def set_up(specimen: str, num_frames: int, total_deg: float, noise_px: float) -> SetUp:
    """A small specimen."""
    return SetUp(
        specimen=SpecimenOptions(specimen=specimen, num_points=NUM_POINTS),  # type: ignore[arg-type]
        size=SeriesSize(num_frames=num_frames, total_deg=total_deg),
        noise=NoiseOptions(noise_px=noise_px),
    )


SET_UPS = (
    set_up("field", 7, 30.0, 0.2),
    set_up("field", 13, 60.0, 0.4),
    set_up("body", 9, 60.0, 0.2),
    set_up("body", 18, 120.0, 0.3),
    set_up("body", 30, 360.0, 0.2),
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """Errors of one reconstruction; nan for what is not in it."""

    depth_px: Float
    """(N,) along the normal"""
    rotation_rad: Float
    """(M, 3) about the camera's x, y, z"""


def one_run(geometry: Geometry, noise: NoiseOptions, rng: np.random.Generator) -> Run:
    """Noisy tracks of a geometry through factorization, filtering and bundle adjustment."""
    obs = noisy(geometry, noise, rng)
    (part,) = find_parts(obs, FactorizationOptions())
    start = factorize(part, obs, FactorizationOptions(), rng)
    assert start.value is not None, start.message
    options = RefinementOptions(scale_sigma=noise.scale_sigma, drift_sigma_px=noise.drift_sigma_px)
    refined = refine(start.value.cameras, part.images, obs, options, rng=rng)
    fit = refined.value
    assert fit is not None, refined.message
    settings = BundleSettings.of(options, fit.sigma_px, last_solver(options))
    height = np.full(len(fit.cameras), geometry.height_px)
    end = adjust_with_drift(fit.cameras, fit.observations, height, settings).value
    assert end is not None
    return errors(geometry, fit.images, fit.tracks, end.cameras.cam_from_world, end.points)


def noisy(geometry: Geometry, noise: NoiseOptions, rng: np.random.Generator) -> Observations:
    """Observations with magnifications and scan drifts from their priors, and noise."""
    obs, M = geometry.observations, len(geometry.cameras)
    scale = np.exp(noise.scale_sigma * rng.normal(size=M))
    cameras = replace(geometry.cameras, scale_px_per_unit=scale)
    xy = cameras.project(geometry.points[obs.track_idx], obs.image_idx)
    drift = noise.drift_sigma_px * rng.normal(size=(M, 2))
    row = xy[:, 1:] / geometry.height_px - 0.5
    xy = xy + drift[obs.image_idx] * row + noise.noise_px * rng.normal(size=xy.shape)
    return replace(obs, xy=xy)


def errors(geometry: Geometry, images: Any, tracks: Any, R: Float, X: Float) -> Run:
    """Errors after the best rigid motion, of the hand that fits."""
    truth = geometry.points[tracks]
    similarity = fit_similarity(X, truth, with_scale=False, with_reflection=True)
    if np.linalg.det(similarity.rotation) < 0.0:
        X, R = X * [1.0, 1.0, -1.0], depth_reversed(R)
        similarity = fit_similarity(X, truth, with_scale=False)
    depth = np.full(len(geometry.points), np.nan)
    off = similarity.apply(X) - truth
    depth[tracks] = np.einsum("nk,nk->n", off, geometry.normals[tracks])
    rotation = np.full((len(geometry.cameras), 3), np.nan)
    true_R = np.asarray(geometry.cameras.cam_from_world)[images]
    rotation[images] = vector_from_rotation(R @ similarity.rotation.T @ true_R.mT)
    return Run(depth_px=depth, rotation_rad=rotation)


def measured(setup: SetUp, runs: int) -> tuple[float, float]:
    """Median depth sigma, px, and rotation sigma, deg: means over the specimens of so many runs."""
    found = []
    for seed in SEEDS:
        geometry = planned_geometry(
            setup.size, setup.specimen, setup.noise, num_sampled=NUM_POINTS, seed=seed
        )
        assert geometry is not None
        done = [one_run(geometry, setup.noise, np.random.default_rng(k)) for k in range(runs)]
        depth = np.sqrt(np.nanmean([run.depth_px**2 for run in done], axis=0))
        rotation = np.sqrt(np.nanmean([run.rotation_rad**2 for run in done], axis=0))
        found.append((np.median(depth), np.rad2deg(np.median(rotation))))
    depth_px, rotation_deg = np.mean(found, axis=0)
    return float(depth_px), float(rotation_deg)


def row(setup: SetUp, planned: PlannedSeries, found: tuple[float, float], runs: int) -> list[str]:
    """A line of the table."""
    depth, rotation = planned.prediction.median_px, planned.prediction.rotation_deg
    return [
        setup.name,
        f"{setup.noise.noise_px:g}",
        str(runs),
        f"{depth:.3f}",
        f"{found[0]:.3f}",
        f"{found[0] / depth:.2f}",
        f"{rotation:.4f}",
        f"{found[1]:.4f}",
        f"{found[1] / rotation:.2f}",
    ]


def main() -> None:
    """Command line."""
    parser = tables.parser("plan", __doc__)
    parser.add_argument("--runs", type=int, default=25, help="runs of each specimen")
    tables.add_page_option(parser, "plan")
    args = parser.parse_args()
    rows = []
    for setup in SET_UPS:
        planned = plan_series(setup.size, setup.specimen, setup.noise)
        assert planned is not None
        rows.append(row(setup, planned, measured(setup, args.runs), args.runs))
        print(tables.line(rows[-1]), flush=True)
    text = tables.table(HEAD, rows)
    if args.markdown:
        tables.put(args.markdown, "plan", text)


if __name__ == "__main__":
    main()
