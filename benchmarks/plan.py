"""`semsfm plan` against Monte Carlo: predicted standard deviations, and errors of full runs.

Specimens that the planner has not seen are simulated. In each run magnifications and scan drifts
are drawn from their priors and noise is added to the tracks, which are factorized, filtered and
bundle-adjusted with the drift as in the mapping stage. Structure and truth are laid on one another
by a rigid motion; of each point the RMS error along its normal over the runs is taken, and the
median over the points is what the planner predicts, for a specimen of its own. Given are means over
the specimens, beside what the covariance says for these specimens themselves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks import tables
from semsfm_colmap.factorization.factorize import factorize, find_parts
from semsfm_colmap.factorization.options import FactorizationOptions
from semsfm_colmap.geometry.alignment import fit_similarity
from semsfm_colmap.geometry.rotations import depth_reversed, vector_from_rotation
from semsfm_colmap.planning.options import NoiseOptions, SpecimenOptions
from semsfm_colmap.planning.prediction import Geometry, predict
from semsfm_colmap.planning.series import (
    SeriesSize,
    plan_series,
    planned_geometry,
)
from semsfm_colmap.refinement.adjustment import BundleSettings, last_solver
from semsfm_colmap.refinement.options import RefinementOptions
from semsfm_colmap.refinement.refine import refine
from semsfm_colmap.refinement.scan_drift import adjust_with_drift
from semsfm_colmap.types import Float, Observations

SEEDS = (7, 8, 9, 10, 11)
"""Of the specimens that are reconstructed; the planner's is 0."""
NUM_POINTS = 300
HEAD = (
    "series",
    "noise px",
    "depth sigma px: planned",
    "predicted for the same specimens",
    "measured",
    "measured / planned",
    "measured / predicted",
    "rotation sigma deg: planned",
    "predicted for the same specimens",
    "measured",
    "measured / predicted",
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


@dataclass(frozen=True, kw_only=True)
class Sigmas:
    """Median standard deviations of a series."""

    depth_px: float
    rotation_deg: float

    @classmethod
    def mean(cls, found: Sequence[Sigmas]) -> Sigmas:
        """Over several specimens."""
        return cls(
            depth_px=float(np.mean([sigmas.depth_px for sigmas in found])),
            rotation_deg=float(np.mean([sigmas.rotation_deg for sigmas in found])),
        )


def measured(setup: SetUp, geometry: Geometry, runs: int) -> Sigmas:
    """RMS errors over runs with one specimen."""
    done = [one_run(geometry, setup.noise, np.random.default_rng(k)) for k in range(runs)]
    depth = np.sqrt(np.nanmean([run.depth_px**2 for run in done], axis=0))
    rotation = np.sqrt(np.nanmean([run.rotation_rad**2 for run in done], axis=0))
    return Sigmas(
        depth_px=float(np.nanmedian(depth)), rotation_deg=float(np.rad2deg(np.median(rotation)))
    )


def predicted(setup: SetUp, geometry: Geometry) -> Sigmas:
    """What the covariance says for this specimen."""
    found = predict(geometry, setup.noise)
    assert found is not None
    return Sigmas(depth_px=found.median_px, rotation_deg=found.rotation_deg)


def specimens(setup: SetUp) -> list[Geometry]:
    """Those that are reconstructed."""
    found = [
        planned_geometry(setup.size, setup.specimen, setup.noise, num_sampled=NUM_POINTS, seed=seed)
        for seed in SEEDS
    ]
    return [geometry for geometry in found if geometry is not None]


def row(setup: SetUp, runs: int) -> list[str]:
    """A line of the table."""
    series = plan_series(setup.size, setup.specimen, setup.noise)
    assert series is not None
    plan = series.prediction
    made = specimens(setup)
    said = Sigmas.mean([predicted(setup, geometry) for geometry in made])
    found = Sigmas.mean([measured(setup, geometry, runs) for geometry in made])
    return [
        setup.name,
        f"{setup.noise.noise_px:g}",
        f"{plan.median_px:.3f}",
        f"{said.depth_px:.3f}",
        f"{found.depth_px:.3f}",
        f"{found.depth_px / plan.median_px:.2f}",
        f"{found.depth_px / said.depth_px:.2f}",
        f"{plan.rotation_deg:.4f}",
        f"{said.rotation_deg:.4f}",
        f"{found.rotation_deg:.4f}",
        f"{found.rotation_deg / said.rotation_deg:.2f}",
    ]


def main() -> None:
    """Command line."""
    parser = tables.parser("plan", __doc__)
    parser.add_argument("--runs", type=int, default=20, help="runs of each of 5 specimens")
    tables.add_page_option(parser, "plan")
    args = parser.parse_args()
    rows = []
    for setup in SET_UPS:
        rows.append(row(setup, args.runs))
        print(tables.line(rows[-1]), flush=True)
    text = tables.table(HEAD, rows)
    if args.markdown:
        tables.put(args.markdown, "plan", text)


if __name__ == "__main__":
    main()
