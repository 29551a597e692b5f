"""The geometry at its limit: every table of docs/benchmark_geometry.md.

usage: benchmark_geometry.py [--only NAME ...] [--data FOLDER] [--markdown FILE] [--quick]

optima      affine optima of published track sets from the one CBC start
efficiency  errors of simulated series against the Cramer-Rao bound, and normalised errors
colmap      the same simulated databases through pycolmap's expert set-up
outliers    10, 20, 30 % of the observations replaced by wrong ones
added       so many wrong matches added that they are 10, 20, 30 % of all
scale       up to 1000 frames and 8 million observations: seconds and peak memory
chain       fine steps and short tracks: in one piece and in segments
ceres       bundle adjustment against Ceres (pycolmap) on one model to the same cost

Times are of one run on a shared machine: compare rows of a table, never runs.
"""

from __future__ import annotations

import argparse
import re
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from simulated_matches import join, simulate_matches, verify

from semsfm_colmap.factorization.blocks import select_blocks
from semsfm_colmap.factorization.cbc import factorize_cbc
from semsfm_colmap.factorization.factorize import (
    factorize,
    factorize_most,
    factorize_whole,
    find_parts,
)
from semsfm_colmap.factorization.options import FactorizationOptions
from semsfm_colmap.factorization.polish import polish_affine
from semsfm_colmap.geometry.band import BandFactor, BandMatrix
from semsfm_colmap.geometry.eliminated import Eliminated, SolverOptions
from semsfm_colmap.geometry.points import residuals, solve_points, track_pointer
from semsfm_colmap.geometry.rotations import (
    depth_reversed,
    nearest_rotation,
    rotation_angle,
    rotation_from_vector,
    vector_from_rotation,
)
from semsfm_colmap.geometry.subset import keep_tracks
from semsfm_colmap.refinement.bundle import BundleModel, bundle_adjust
from semsfm_colmap.refinement.covariance import estimate_covariance
from semsfm_colmap.refinement.options import RefinementOptions
from semsfm_colmap.refinement.refine import refine
from semsfm_colmap.synthetic.tracks import SimulatedTracks, simulate_tracks
from semsfm_colmap.tracks.build import build_tracks
from semsfm_colmap.tracks.split import split_tracks
from semsfm_colmap.types import AffineModel, Observations, OrthographicCameras

OPTIMA_PX = {"dinosaur trimmed": 1.270153, "dinosaur full": 1.217574, "house": 2.750877}
SERIES = (
    # frames, range, tracks, body, window
    (60, 180.0, 2000, "body", 10),
    (7, 30.0, 600, "field", 0),
    (5, 12.0, 600, "field", 0),
    (3, 10.0, 600, "field", 0),
)
NUM_SERIES = {60: 100, 7: 150, 5: 150, 3: 150}
"""Series a row of the table of efficiency, by number of frames."""
NUM_REPLACED = {60: 40, 7: 60, 5: 60}
"""Series a row where observations are replaced by wrong ones."""
NUM_ADDED = {60: 24, 7: 24, 5: 24}
"""Series a row where wrong matches are added."""
SHARES = (0.0, 0.1, 0.2, 0.3)
NOISE_PX = 0.3


def markdown(head: list[str], rows: list[list[Any]]) -> str:
    """A table."""
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    lines += ["| " + " | ".join(str(cell) for cell in row) + " |" for row in rows]
    return "\n".join(lines)


# -- published optima ------------------------------------------------------------------------------


def read_tracks(folder: Path, name: str) -> Observations:
    """A published track set as observations."""
    from scipy.io import loadmat

    if name == "dinosaur full":
        table = np.loadtxt(folder / "dinosaur_viff.xy")
        table[table == -1] = np.nan
        M = table.T
    else:
        content = loadmat(folder / f"{name.replace(' ', '_')}.mat")
        M = np.where(content["W"] != 0, content["M"], np.nan).astype(float)
    xy = M.reshape(len(M) // 2, 2, -1).transpose(2, 0, 1)
    seen = np.isfinite(xy).all(axis=2)
    keep = seen.sum(axis=1) >= 2
    xy, seen = xy[keep], seen[keep]
    track_idx, image_idx = np.nonzero(seen)
    return Observations(
        image_idx=image_idx,
        track_idx=track_idx,
        keypoint_idx=np.arange(len(track_idx)),
        xy=xy[seen],
        num_images=xy.shape[1],
        num_tracks=len(xy),
    )


def affine_optimum(obs: Observations) -> tuple[float, float, int, float]:
    """CBC residual, polished residual, iterations, seconds."""
    begin = time.monotonic()
    options = FactorizationOptions(block_ransac_trials=0)
    blocks = select_blocks(obs, options)
    start = factorize_cbc(blocks, obs.num_images, options, np.random.default_rng(0))
    assert start.value is not None
    A, t = start.value.A, start.value.t
    pointer = track_pointer(obs.track_idx, obs.num_tracks)
    X = solve_points(A, t, obs.image_idx, pointer, obs.xy, np.ones(len(obs)))
    r = residuals(A, t, np.nan_to_num(X), obs.image_idx, obs.track_idx, obs.xy)
    polish = polish_affine(
        AffineModel(A=A, t=t, X=X),
        obs,
        solver=SolverOptions(max_iterations=300, cost_tolerance=1e-12),
    )
    return (
        float(np.sqrt(np.mean(r**2))),
        float(polish.diagnostics["rms_px"]),
        polish.iterations,
        time.monotonic() - begin,
    )


def table_optima(data: Path, quick: bool) -> str:
    rows = []
    for name, optimum in OPTIMA_PX.items():
        obs = read_tracks(data / "tracks", name)
        affine_optimum(obs)  # compile
        cbc, found, iterations, seconds = affine_optimum(obs)
        relative = (found - optimum) / optimum
        rows.append(
            [
                name,
                f"{obs.num_images} x {obs.num_tracks}",
                f"{cbc:.4f}",
                f"{found:.6f}",
                f"{optimum:.6f}",
                f"{relative:+.1e}",
                iterations,
                f"{seconds:.2f}",
            ]
        )
    return markdown(
        ["set", "size", "CBC px", "polished px", "published px", "difference", "steps", "s"], rows
    )


# -- simulated series ------------------------------------------------------------------------------


def simulate(row: tuple[Any, ...], known_scale: bool, seed: int, **options: Any) -> SimulatedTracks:
    frames, range_deg, tracks, body, window = row
    return simulate_tracks(
        num_images=frames,
        range_deg=range_deg,
        num_tracks=tracks,
        body=body,
        track_window=window,
        noise_px=NOISE_PX,
        scale_drift=0.0 if known_scale else RefinementOptions().scale_sigma,
        rng=np.random.default_rng(seed),
        **options,
    )


def solve(s: SimulatedTracks, known_scale: bool) -> Any:
    """The whole mapping of the program, from tracks to refined cameras."""
    rng = np.random.default_rng(0)
    factorization = FactorizationOptions()
    part = find_parts(s.observations, factorization)[0]
    tied, start = factorize_most(part, s.observations, factorization, rng)
    assert start.value is not None, start.message
    options = RefinementOptions(
        camera_model="orthographic" if known_scale else "scaled_orthographic"
    )
    seen = split_tracks(
        s.observations,
        start.value[0],
        tied.images,
        min_length=options.min_track_length,
        trials=options.ransac_trials,
    )
    fit = refine(start.value[0], tied.images, seen, options, rng=rng)
    assert fit.value is not None, fit.message
    return fit.value


def aligned(
    cameras: OrthographicCameras, points: Any, true: OrthographicCameras
) -> tuple[Any, Any, Any]:
    """Rotations and points in the truth's world, and the matrix T of ``X -> X T - shift``."""
    R_true = np.asarray(true.cam_from_world)
    candidates = []
    for reverse in (False, True):
        R = np.asarray(cameras.cam_from_world)
        D = np.diag([1.0, 1.0, -1.0 if reverse else 1.0])
        R = D @ R @ D
        Q = nearest_rotation(np.einsum("mji,mjk->ik", R, R_true))
        candidates.append((R @ Q, D @ Q))
    R, T = min(candidates, key=lambda c: np.median(rotation_angle(c[0] @ R_true.mT)))
    P = true.projection.reshape(-1, 3)
    gap = (np.asarray(true.translation_px) - np.asarray(cameras.translation_px)).ravel()
    shift = np.linalg.lstsq(P, gap, rcond=None)[0]
    return R, T, np.asarray(points) @ T - shift


def cramer_rao(s: SimulatedTracks, known_scale: bool) -> Any:
    """Covariance of poses and points at the truth, priors included."""
    model = BundleModel.build(
        len(s.cameras),
        free_scale=not known_scale,
        free_affine=False,
        scale_sigma=RefinementOptions().scale_sigma,
        affine_sigma=1.0,
    )
    state = Eliminated(
        params=s.cameras,
        X=np.asarray(s.points),
        residuals=np.zeros((len(s.observations), 2)),
        weight=np.ones(len(s.observations)),
        cost=0.0,
    )
    return estimate_covariance(model, state, s.observations, NOISE_PX).value


def table_efficiency(data: Path, quick: bool) -> str:
    rows = []
    for series in SERIES:
        count = 10 if quick else NUM_SERIES[series[0]]
        for known in (True, False):
            figures = np.array([efficiency(series, known, seed) for seed in range(count)])
            error2, bound2, points, rotation_square, point_square = figures.mean(axis=0)
            spread = figures.std(axis=0, ddof=1) / np.sqrt(count)
            rows.append(
                [
                    f"{series[0]} / {series[1]:g} deg",
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
    return (
        f"{NOISE_PX} px noise. To the bound: root mean square error over the "
        "Cramer-Rao bound at the truth, prior included, over all images and points; normalised: "
        "mean square of the errors in units of the error bars that the program gives (1: the bars "
        "are true). ± is the standard error of the benchmark itself.\n\n"
        + markdown(
            [
                "frames / range",
                "scale",
                "series",
                "rotation RMS deg",
                "rotation to the bound",
                "points to the bound",
                "normalised rotation²",
                "normalised points²",
            ],
            rows,
        )
    )


def efficiency(series: tuple[Any, ...], known: bool, seed: int) -> tuple[float, ...]:
    """Squared rotation error, its bound, squared points over bound, both normalised squares."""
    s = simulate(series, known, seed)
    fit = solve(s, known)
    bound = cramer_rao(s, known)
    R, T, X = aligned(fit.cameras, fit.points, s.cameras.select(fit.images))
    R_true = np.asarray(s.cameras.cam_from_world)[fit.images]
    w = vector_from_rotation(R @ R_true.mT)
    d = X - np.asarray(s.points)[fit.tracks]
    weight = 1.0 / np.trace(bound.points[fit.tracks], axis1=1, axis2=2)
    own = estimate_covariance(fit.model, fit.state, fit.observations, fit.sigma_px)
    assert own.value is not None
    # the error bars are of rotations about the camera's axes in the program's hand; squares of the
    # components do not change with it
    C = T.T @ own.value.points @ T
    return (
        float(np.mean(np.sum(w * w, axis=1))),
        float(np.mean(np.sum(bound.sigma_rotation_rad[fit.images] ** 2, axis=1))),
        float(np.mean(weight * np.sum(d * d, axis=1))),
        float(np.mean((w / own.value.sigma_rotation_rad) ** 2)),
        float(np.mean(np.einsum("ni,nij,nj->n", d, np.linalg.inv(C), d)) / 3.0),
    )


def errors(fit: Any, s: SimulatedTracks, true: Any = None) -> tuple[float, float]:
    """RMS rotation error in deg and median point error relative to the object's size.

    Parameters
    ----------
    true : the points that the tracks of the fit show, nan for none; from the scene when not given

    """
    if true is None:
        # tracks cut off from others show nothing that is known
        cut_off = fit.tracks >= len(s.points)
        true = np.where(cut_off[:, None], np.nan, s.points[np.where(cut_off, 0, fit.tracks)])
    R, _, X = aligned(fit.cameras, fit.points, s.cameras.select(fit.images))
    angle = rotation_angle(R @ np.asarray(s.cameras.cam_from_world)[fit.images].mT)
    d = X - true
    size = np.sqrt(np.mean(np.sum((s.points - s.points.mean(axis=0)) ** 2, axis=1)))
    middle = np.sqrt(np.nanmedian(np.sum(d * d, axis=1)))
    return float(np.rad2deg(np.sqrt(np.mean(angle**2)))), float(middle / size)


def only_right(s: SimulatedTracks) -> SimulatedTracks:
    """The scene without its wrong observations, as an oracle would see it."""
    return replace(s, observations=s.observations.select(s.correct))


def bounds(s: SimulatedTracks, rng: Any) -> tuple[float, float]:
    """What the Cramer-Rao bound says of `errors`: of the right observations of tracks of three.

    The median error of points that differ in their bounds is found by drawing errors from them.
    """
    right = only_right(s).observations
    length = np.bincount(right.track_idx, minlength=right.num_tracks)
    kept, tracks = keep_tracks(right, length[right.track_idx] >= 3)
    bound = cramer_rao(replace(s, observations=kept, points=np.asarray(s.points)[tracks]), False)
    rotation = np.sqrt(np.mean(np.sum(bound.sigma_rotation_rad**2, axis=1)))
    L = np.linalg.cholesky(bound.points[np.isfinite(bound.points[:, 0, 0])])
    drawn = np.einsum("nij,knj->kni", L, rng.normal(size=(20, len(L), 3)))
    return float(rotation), float(np.sqrt(np.median(np.sum(drawn**2, axis=2))))


def rms(figures: list[tuple[float, float]]) -> Any:
    """Root mean squares over the series."""
    return np.sqrt(np.mean(np.square(figures), axis=0))


def ratio(some: list[tuple[float, float]], base: list[tuple[float, float]]) -> list[str]:
    """Ratio of the RMS of the same series, and its standard error by the jackknife."""
    square = np.square([some, base])  # (2, series, 2)
    n = square.shape[1]
    without = (square.sum(axis=1, keepdims=True) - square) / (n - 1)
    left = np.sqrt(without[0] / without[1])
    error = np.sqrt((n - 1) * np.mean((left - left.mean(axis=0)) ** 2, axis=0))
    value = rms(some) / rms(base)
    return [f"{v:.2f} ± {e:.2f}" for v, e in zip(value, error, strict=True)]


def table_outliers(data: Path, quick: bool) -> str:
    rows = []
    for series in SERIES[:3]:
        count = 4 if quick else NUM_REPLACED[series[0]]
        clean: list[tuple[float, float]] = []
        clean_bound: list[tuple[float, float]] = []
        for share in SHARES:
            figures, oracle, bound = [], [], []
            for seed in range(count):
                s = simulate(series, False, seed, outlier_share=share)
                figures.append(errors(solve(s, False), s))
                oracle.append(errors(solve(only_right(s), False), s))
                bound.append(bounds(s, np.random.default_rng(seed)))
            clean, clean_bound = clean or figures, clean_bound or bound
            rotation, structure = rms(figures)
            to_oracle, to_clean = ratio(figures, oracle), ratio(figures, clean)
            least = rms(bound) / rms(clean_bound)
            rows.append(
                [
                    f"{series[0]} / {series[1]:g} deg",
                    f"{share:.0%}",
                    count,
                    f"{rotation:.4f}",
                    to_oracle[0],
                    to_clean[0],
                    f"{least[0]:.2f}",
                    f"{100 * structure:.4f} %",
                    to_oracle[1],
                    to_clean[1],
                    f"{least[1]:.2f}",
                ]
            )
            print(rows[-1], flush=True)
    return (
        "A wrong observation stands in the place of a right one, so wrong ones both mislead and "
        "are missing. *To the oracle*: against the same right observations alone, what the wrong "
        "ones spoil. *To clean*: against the same series before any was replaced. *Bound*: what is "
        "missing alone, the Cramer-Rao bound of the right observations that are left (of tracks "
        "that keep three) over that of all: no method comes below. ± is the standard error of the "
        "benchmark.\n\n"
        + markdown(
            [
                "frames / range",
                "wrong",
                "series",
                "rotation deg",
                "to the oracle",
                "to clean",
                "bound",
                "points",
                "to the oracle",
                "to clean",
                "bound",
            ],
            rows,
        )
    )


def table_added(data: Path, quick: bool) -> str:
    rows = []
    for series in SERIES[:3]:
        count = 4 if quick else NUM_ADDED[series[0]]
        clean: list[tuple[float, float]] = []
        for share in SHARES:
            figures, shares = [], []
            for seed in range(count):
                s = simulate(series, False, seed)
                put = simulate_matches(s, share, np.random.default_rng([seed, 1]))
                verified = verify(put, seed)
                fit = solve(replace(s, observations=join(put, verified)), False)
                shown, misplaced = put.shown(fit)
                true = np.where(shown[:, None] >= 0, s.points[shown], np.nan)
                figures.append(errors(fit, s, true))
                shares.append(
                    (
                        put.wrong_share(put.matches),
                        put.wrong_share(verified),
                        misplaced,
                        float(len(fit.observations)),
                    )
                )
            clean = clean or figures
            rotation, structure = rms(figures)
            to_clean = ratio(figures, clean)
            added, passed, left, kept = np.mean(shares, axis=0)
            rows.append(
                [
                    f"{series[0]} / {series[1]:g} deg",
                    f"{added:.1%}",
                    count,
                    f"{passed:.1%}",
                    f"{left:.2%}",
                    f"{kept:.0f}",
                    f"{rotation:.4f}",
                    to_clean[0],
                    f"{100 * structure:.4f} %",
                    to_clean[1],
                ]
            )
            print(rows[-1], flush=True)
    return (
        "All right matches of the clean series stay (images up to ten apart), and so many wrong "
        "ones come that they are the given share of all: half of them between any keypoints "
        "without a partner, half between such keypoints that lie within 2 px of each other's "
        "epipolar line and move like the right ones. Verification, track building and mapping are "
        "the program's. *Verified*: share of wrong ones among the verified matches; *left*: among "
        "the observations of the model. *To clean*: against the same series without wrong matches, "
        "± the standard error of the benchmark.\n\n"
        + markdown(
            [
                "frames / range",
                "wrong",
                "series",
                "verified",
                "left",
                "observations",
                "rotation deg",
                "to clean",
                "points",
                "to clean",
            ],
            rows,
        )
    )


# -- pycolmap --------------------------------------------------------------------------------------


def write_database(s: SimulatedTracks, path: Path, focal_px: float, size: int = 1200) -> None:
    """The simulated tracks as a COLMAP database with matches and two-view geometries."""
    from semsfm_colmap.colmap.library import pycolmap

    obs = s.observations
    keypoints = []
    row_of = np.full((obs.num_images, obs.num_tracks), -1)
    for i in range(obs.num_images):
        o = np.flatnonzero(obs.image_idx == i)
        keypoints.append(obs.xy[o])
        row_of[i, obs.track_idx[o]] = np.arange(len(o))
    with pycolmap.Database.open(str(path)) as db, pycolmap.DatabaseTransaction(db):
        camera = pycolmap.Camera(
            model="SIMPLE_PINHOLE",
            width=size,
            height=size,
            params=[focal_px, size / 2, size / 2],
            has_prior_focal_length=True,
        )
        camera_id = db.write_camera(camera)
        for i in range(obs.num_images):
            db.write_image(
                pycolmap.Image(name=f"{i:04d}.png", camera_id=camera_id, image_id=i + 1), True
            )
            db.write_keypoints(i + 1, keypoints[i].astype(np.float32))
        for i in range(obs.num_images):
            for j in range(i + 1, min(i + 11, obs.num_images)):
                both = np.flatnonzero((row_of[i] >= 0) & (row_of[j] >= 0))
                if len(both) >= 15:
                    pair = np.column_stack([row_of[i, both], row_of[j, both]]).astype(np.uint32)
                    db.write_matches(i + 1, j + 1, pair)


def map_with_colmap(
    s: SimulatedTracks, focal_px: float, folder: Path
) -> tuple[Any, tuple[float, float]]:
    """The expert set-up in a process of its own, which may abort; model or None, wall and CPU s."""
    from semsfm_colmap.colmap.library import pycolmap

    database = folder / "database.db"
    write_database(s, database, focal_px)
    pairs = folder / "pairs.txt"
    M = len(s.cameras)
    pairs.write_text(
        "".join(
            f"{i:04d}.png {j:04d}.png\n" for i in range(M) for j in range(i + 1, min(i + 11, M))
        )
    )
    done = subprocess.run(
        [sys.executable, __file__, "--colmap", str(folder)],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        timeout=600,
        check=False,
    )
    said = dict(x.split() for x in done.stdout.splitlines() if x.startswith(("SECONDS ", "CPU ")))
    seconds = (float(said.get("SECONDS", "nan")), float(said.get("CPU", "nan")))
    models = [pycolmap.Reconstruction(str(p.parent)) for p in folder.glob("*/points3D.bin")]
    if "CPU" not in said or not models:
        return None, seconds
    return max(models, key=lambda m: m.num_reg_images()), seconds


def run_colmap(folder: Path) -> None:
    """Verify and map: fixed long focal length, raised filter on focal lengths."""
    from semsfm_colmap.colmap.library import pycolmap

    database = str(folder / "database.db")
    pycolmap.verify_matches(database, str(folder / "pairs.txt"))
    options = pycolmap.IncrementalPipelineOptions()
    options.ba_refine_focal_length = False
    options.ba_refine_extra_params = False
    options.max_focal_length_ratio = 1e9
    options.mapper.max_focal_length_ratio = 1e9
    options.triangulation.max_focal_length_ratio = 1e9
    begin, begin_cpu = time.monotonic(), time.process_time()
    pycolmap.incremental_mapping(database, str(folder), str(folder), options=options)
    print(f"SECONDS {time.monotonic() - begin:.3f}", flush=True)
    print(f"CPU {time.process_time() - begin_cpu:.3f}", flush=True)


def colmap_errors(model: Any, s: SimulatedTracks) -> tuple[float, float]:
    """RMS rotation error in deg and structure error, as `errors`, of the better hand."""
    images = sorted((i for i in model.images.values() if i.has_pose), key=lambda i: i.name)
    R = np.array([np.asarray(i.cam_from_world().matrix())[:, :3] for i in images])
    idx = np.array([int(Path(i.name).stem) for i in images])
    R_true = np.asarray(s.cameras.cam_from_world)[idx]
    obs = s.observations
    tracks = [obs.track_idx[obs.image_idx == i] for i in range(len(s.cameras))]
    X, j = [], []
    for point in model.points3D.values():
        e = point.track.elements[0]
        X.append(point.xyz)
        j.append(tracks[int(Path(model.images[e.image_id].name).stem)][e.point2D_idx])
    best = []
    for candidate, mirror in ((R, [1, 1, 1]), (depth_reversed(R), [1, 1, -1])):
        Q = nearest_rotation(np.einsum("mji,mjk->ik", candidate, R_true))
        angle = rotation_angle(candidate @ Q @ R_true.mT)
        structure = structure_error(np.array(X) * mirror, np.asarray(s.points)[j])
        best.append((float(np.rad2deg(np.sqrt(np.mean(angle**2)))), structure))
    return min(best)


def structure_error(X: Any, true: Any) -> float:
    """Median distance after the best similarity, relative to the object's size [Umeyama 1991]."""
    a, b = X - np.median(X, axis=0), true - np.median(true, axis=0)
    for _ in range(5):  # without the points that are far off
        distance = np.linalg.norm(a - b, axis=1) if _ else np.zeros(len(a))
        good = distance <= 5.0 * np.median(distance) if _ else np.ones(len(a), dtype=bool)
        a, b = a - a[good].mean(axis=0), b - b[good].mean(axis=0)
        Q = nearest_rotation(a[good].T @ b[good])
        a = a @ Q
        a *= np.sum(a[good] * b[good]) / np.sum(a[good] ** 2)
    size = np.sqrt(np.mean(np.sum(b * b, axis=1)))
    return float(np.median(np.linalg.norm(a - b, axis=1)) / size)


def from_matches(s: SimulatedTracks, database: Path) -> tuple[SimulatedTracks, tuple[float, float]]:
    """Tracks joined from verified matches, as the program joins them; wall and CPU seconds."""
    from semsfm_colmap.colmap.database.work import open_database, read_inlier_matches

    begin, begin_cpu = time.monotonic(), time.process_time()
    with open_database(database) as db:
        images = sorted(db.read_all_images(), key=lambda image: image.name)
        number = {image.image_id: k for k, image in enumerate(images)}
        keypoints = [np.asarray(db.read_keypoints(i.image_id))[:, :2].astype(float) for i in images]
    matches = read_inlier_matches(database)
    pairs = {(number[a], number[b]): rows for (a, b), rows in matches.items()}
    observations, _ = build_tracks(keypoints, pairs, min_length=2)
    seconds = (time.monotonic() - begin, time.process_time() - begin_cpu)
    # number the points of the truth like the tracks
    lookup = {}
    for i in range(len(s.cameras)):
        for k, o in enumerate(np.flatnonzero(s.observations.image_idx == i)):
            lookup[i, k] = o
    keys = zip(observations.image_idx, observations.keypoint_idx, strict=True)
    rows = [lookup[int(i), int(k)] for i, k in keys]
    first = np.unique(observations.track_idx, return_index=True)[1]
    point = s.observations.track_idx[np.array(rows)[first]]
    return replace(s, observations=observations, points=np.asarray(s.points)[point]), seconds


COLMAP_ROWS = (
    # series, tracks, share of wrong observations, seeds
    (SERIES[0], 6000, 0.0, 3),
    (SERIES[0], 15000, 0.1, 3),
    (SERIES[1], 600, 0.0, 6),
    (SERIES[2], 600, 0.0, 6),
    (SERIES[3], 600, 0.0, 6),
)


def table_colmap(data: Path, quick: bool) -> str:
    rows = []
    solve(simulate(SERIES[1], False, 0), False)  # compile
    for series, tracks, share, seeds in COLMAP_ROWS:
        figures, times, failed = [], [], 0
        for seed in range(min(seeds, 2) if quick else seeds):
            s = simulate((*series[:2], tracks, *series[3:]), False, seed, outlier_share=share)
            with tempfile.TemporaryDirectory() as folder:
                model, theirs = map_with_colmap(s, 1e5, Path(folder))
                joined, seconds = from_matches(s, Path(folder) / "database.db")
            begin, begin_cpu = time.monotonic(), time.process_time()
            fit = solve(joined, False)
            wall = seconds[0] + time.monotonic() - begin
            times.append((wall, seconds[1] + time.process_time() - begin_cpu, *theirs))
            found = fit.points * hand(fit, s)
            ours = (errors(fit, joined)[0], structure_error(found, joined.points[fit.tracks]))
            if model is None or model.num_reg_images() < len(s.cameras):
                failed += 1
            figures.append((*ours, *(colmap_errors(model, s) if model else (np.nan, np.nan))))
        errors_rms = np.sqrt(np.nanmean(np.square(figures), axis=0))
        ours_s, ours_cpu, theirs_s, theirs_cpu = np.nanmedian(times, axis=0)
        rows.append(
            [
                f"{series[0]} / {series[1]:g} deg",
                tracks,
                f"{share:.0%}",
                len(figures),
                f"{errors_rms[0]:.3f}, {100 * errors_rms[1]:.3f} %",
                f"{errors_rms[2]:.3f}, {100 * errors_rms[3]:.3f} %",
                failed,
                f"{ours_s:.2f} ({ours_cpu:.2f})",
                f"{theirs_s:.2f} ({theirs_cpu:.2f})",
                f"{theirs_s / ours_s:.1f} ({theirs_cpu / ours_cpu:.1f})",
            ]
        )
        print(rows[-1], flush=True)
    return (
        "The same verified matches (images up to ten apart) in one database: through this "
        "program's tracks, factorization and refinement, and through "
        "`pycolmap.incremental_mapping` with a fixed focal length of 1e5 px and the filter on "
        "focal lengths raised. RMS over the series of the rotation error in degrees and of "
        "the median point error relative to the size of the object; of COLMAP's model the "
        "better hand counts. Seconds are medians, without verifying the matches, and ours "
        "include reading the database and joining the tracks; in brackets processor time, which "
        "does not depend on what else the machine does.\n\n"
        + markdown(
            [
                "frames / range",
                "tracks",
                "wrong",
                "series",
                "ours: deg, points",
                "COLMAP: deg, points",
                "COLMAP lost images in",
                "ours s (CPU)",
                "COLMAP s (CPU)",
                "times faster (CPU)",
            ],
            rows,
        )
    )


def hand(fit: Any, s: SimulatedTracks) -> Any:
    """(3,) factors that bring a fit into the hand of the truth."""
    _, T, _ = aligned(fit.cameras, fit.points, s.cameras.select(fit.images))
    return np.array([1.0, 1.0, np.sign(np.linalg.det(T))])


def table_ceres(data: Path, quick: bool) -> str:
    """Both start from the same disturbed cameras and points and end at the same cost."""
    from semsfm_colmap.colmap.library import pycolmap
    from semsfm_colmap.colmap.model.telecentric import pinhole_cameras

    rows = []
    for tracks in (6000,) if quick else (6000, 15000):
        s = simulate((60, 180.0, tracks, "body", 8), True, 0)
        rng = np.random.default_rng(1)
        start = BundleModel.build(
            60, free_scale=False, free_affine=False, scale_sigma=1.0, affine_sigma=1.0
        ).retract(s.cameras, 0.002 * rng.normal(size=300))
        solver = SolverOptions(cost_tolerance=1e-8)
        kwargs = {"scale_sigma": 10.0, "sigma_px": NOISE_PX, "solver": solver}
        bundle_adjust(start, s.observations, **kwargs)
        begin = time.monotonic()
        fit = bundle_adjust(start, s.observations, **kwargs)
        ours = time.monotonic() - begin
        state = fit.diagnostics["state"]
        our_cost = float(np.sum(state.residuals**2))

        focal, size = 1e6, 1200
        obs = s.observations
        pointer = track_pointer(obs.track_idx, obs.num_tracks)
        X = solve_points(
            start.projection,
            np.asarray(start.translation_px),
            obs.image_idx,
            pointer,
            obs.xy,
            np.ones(len(obs)),
        )
        model = pycolmap.Reconstruction()
        camera = pycolmap.Camera(
            model="SIMPLE_PINHOLE",
            width=size,
            height=size,
            params=[focal, size / 2, size / 2],
            camera_id=1,
        )
        model.add_camera_with_trivial_rig(camera)
        T = pinhole_cameras(start, np.full((60, 2), size), focal).translation
        number = np.empty(len(obs), dtype=int)
        for i in range(60):
            o = np.flatnonzero(obs.image_idx == i)
            number[o] = np.arange(len(o))
            image = pycolmap.Image(
                name=f"{i}.png", keypoints=np.array(obs.xy[o]), camera_id=1, image_id=i + 1
            )
            pose = pycolmap.Rigid3d(pycolmap.Rotation3d(np.array(start.cam_from_world[i])), T[i])
            model.add_image_with_trivial_frame(image, pose)
        for j in range(obs.num_tracks):
            track = pycolmap.Track()
            for o in range(pointer[j], pointer[j + 1]):
                track.add_element(int(obs.image_idx[o]) + 1, int(number[o]))
            model.add_point3D(X[j], track, np.zeros(3, dtype=np.uint8))
        options = pycolmap.BundleAdjustmentOptions()
        options.refine_focal_length = False
        options.refine_extra_params = False
        options.print_summary = False
        options.ceres.solver_options.function_tolerance = 1e-8
        options.ceres.solver_options.max_num_iterations = 200
        begin = time.monotonic()
        pycolmap.bundle_adjustment(model, options)
        theirs = time.monotonic() - begin
        their_cost = 0.0
        for point in model.points3D.values():
            for e in point.track.elements:
                image = model.images[e.image_id]
                d = image.project_point(point.xyz) - image.points2D[e.point2D_idx].xy
                their_cost += float(d @ d)
        rows.append(
            [
                len(obs),
                f"{our_cost:.1f}",
                f"{their_cost:.1f}",
                f"{ours:.2f}",
                f"{theirs:.2f}",
                f"{theirs / ours:.1f}",
            ]
        )
        print(rows[-1], flush=True)
    return markdown(
        ["observations", "our cost px^2", "Ceres cost px^2", "ours s", "Ceres s", "times faster"],
        rows,
    )


# -- scale -----------------------------------------------------------------------------------------


TRACK_SPAN_DEG = 30.0
"""Rotation that a track lasts, or as many frames as it has observations if that is more."""


def long_series(
    frames: int, tracks: int, length: int, seed: int = 0, span_deg: float = TRACK_SPAN_DEG
) -> SimulatedTracks:
    """A turn, tracks of a fixed length, made without a dense visibility matrix.

    Fine steps do not make tracks last longer in degrees: a track has its observations in some of
    the frames of a run of `span_deg`, or in a run of as many frames as it has observations.
    """
    rng = np.random.default_rng(seed)
    angles = 2.0 * np.pi * np.arange(frames) / frames
    R = rotation_from_vector(0.01 * rng.normal(size=(frames, 3))) @ rotation_from_vector(
        angles[:, None] * np.array([0.0, 1.0, 0.0])
    )
    cameras = OrthographicCameras(
        cam_from_world=R,
        scale_px_per_unit=np.exp(0.0005 * rng.normal(size=frames)),
        translation_px=600.0 + 20.0 * rng.normal(size=(frames, 2)),
    )
    window = max(length, round(frames * span_deg / 360.0))
    first = rng.integers(0, frames, tracks)
    # the point faces the middle of its window
    middle = angles[(first + window // 2) % frames]
    radius = 400.0 * (1.0 + 0.1 * rng.normal(size=tracks))
    side = middle + 0.5 * rng.normal(size=tracks)
    points = np.column_stack(
        [radius * np.sin(side), rng.uniform(-400, 400, tracks), -radius * np.cos(side)]
    )
    track_idx = np.repeat(np.arange(tracks), length)
    image_idx = np.empty((tracks, length), dtype=np.int64)
    xy = np.empty((len(track_idx), 2))
    for begin in range(0, tracks, 100_000):
        some = slice(begin, min(begin + 100_000, tracks))
        num = some.stop - some.start
        picked = rng.random((num, window)).argpartition(length - 1, axis=1)[:, :length]
        image_idx[some] = np.sort((first[some, None] + picked) % frames, axis=1)
        rows = slice(some.start * length, some.stop * length)
        xy[rows] = cameras.project(points[track_idx[rows]], image_idx[some].ravel())
    xy += NOISE_PX * rng.normal(size=xy.shape)
    observations = Observations(
        image_idx=image_idx.ravel(),
        track_idx=track_idx,
        keypoint_idx=np.arange(len(track_idx)),
        xy=xy,
        num_images=frames,
        num_tracks=tracks,
    )
    return SimulatedTracks(
        cameras=cameras,
        points=points,
        observations=observations,
        correct=np.ones(len(track_idx), dtype=bool),
    )


CHAINS = ((250, 15_000, 8), (500, 30_000, 8), (1000, 60_000, 8))
"""Frames, tracks, consecutive frames of a track."""


def table_chain(data: Path, quick: bool) -> str:
    rows = []
    for frames, tracks, length in CHAINS[:1] if quick else CHAINS:
        s = long_series(frames, tracks, length, span_deg=0.0)
        obs, options = s.observations, FactorizationOptions()
        part = find_parts(obs, options)[0]
        true = s.cameras.select(part.images)
        cells: list[Any] = []
        start: Any = None
        for function in (factorize_whole, factorize):
            start = function(part, obs, options, np.random.default_rng(0))
            assert start.value is not None, start.message
            R, _, _ = aligned(*start.value, true)
            angle = rotation_angle(R @ np.asarray(true.cam_from_world).mT)
            rms_deg = np.rad2deg(np.sqrt(np.mean(angle**2)))
            cells.append(f"{rms_deg:.2f} ({start.diagnostics['eigenvalue_gap']:.2f})")
        fit = refine(
            start.value[0], part.images, obs, RefinementOptions(), rng=np.random.default_rng(0)
        ).value
        assert fit is not None
        bound = cramer_rao(s, False)
        least = np.sqrt(np.mean(np.sum(bound.sigma_rotation_rad**2, axis=1)))
        rows.append(
            [
                frames,
                f"{tracks:,}",
                f"{360.0 * length / frames:.1f}",
                f"{frames / length:.0f}",
                *cells,
                start.diagnostics.get("num_segments", 1),
                f"{errors(fit, s)[0]:.2f}",
                f"{np.rad2deg(least):.2f}",
            ]
        )
        print(rows[-1], flush=True)
    return (
        "A closed turn, each track in 8 consecutive frames. RMS rotation error in degrees of the "
        "start of the bundle adjustment, factorized in one piece and in overlapping segments, with "
        "the gap of eigenvalues in brackets; after refinement; and its Cramer-Rao bound.\n\n"
        + markdown(
            [
                "frames",
                "tracks",
                "track deg",
                "track lengths a turn",
                "one piece deg (gap)",
                "segments deg (gap)",
                "segments",
                "refined deg",
                "bound deg",
            ],
            rows,
        )
    )


def peak_gb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20


def watch_reduced_system() -> list[float]:
    """Seconds of every call that sets up, factorises, solves or inverts a reduced system."""
    spent: list[float] = []

    def watched(function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*args: Any, **kwargs: Any) -> Any:
            begin = time.monotonic()
            try:
                return function(*args, **kwargs)
            finally:
                spent.append(time.monotonic() - begin)

        return call

    for owner, name in (
        (BandMatrix, "add_blocks"),
        (BandMatrix, "get_blocks"),
        (BandMatrix, "factorise"),
        (BandFactor, "solve"),
        (BandFactor, "inverse"),
    ):
        setattr(owner, name, watched(getattr(owner, name)))
    return spent


def run_scale(frames: int, tracks: int) -> None:
    """One size in a process of its own, so that the peak memory is its own."""
    solve(simulate(SERIES[1], False, 0), False)  # compile
    s = long_series(frames, tracks, 8)
    obs, base = s.observations, peak_gb()
    rng = np.random.default_rng(0)
    times, memory, reduced = [], [], []
    spent = watch_reduced_system()
    begin, begin_cpu = time.monotonic(), time.process_time()

    def lap() -> None:
        nonlocal begin
        times.append(time.monotonic() - begin)
        memory.append(peak_gb())
        reduced.append(sum(spent))
        spent.clear()
        begin = time.monotonic()

    options = FactorizationOptions()
    part = find_parts(obs, options)[0]
    lap()
    tied, start = factorize_most(part, obs, options, rng)
    assert start.value is not None, start.message
    lap()
    chosen = RefinementOptions()
    seen = split_tracks(
        obs,
        start.value[0],
        tied.images,
        min_length=chosen.min_track_length,
        trials=chosen.ransac_trials,
    )
    fit = refine(start.value[0], tied.images, seen, chosen, rng=rng)
    assert fit.value is not None
    lap()
    v = fit.value
    estimate_covariance(v.model, v.state, v.observations, v.sigma_px)
    lap()
    rotation, _ = errors(v, s)
    cells = [
        frames,
        f"{tracks:,}",
        f"{len(obs):,}",
        *[f"{t:.1f} s, {m:.1f} GB" for t, m in zip(times, memory, strict=True)],
        f"{sum(reduced[2:]):.2f}",
        f"{sum(times):.0f}",
        f"{time.process_time() - begin_cpu:.0f}",
        f"{max(memory):.1f}",
        f"{base:.1f}",
        f"{rotation:.4f}",
    ]
    print("ROW|" + "|".join(str(c) for c in cells), flush=True)


def table_scale(data: Path, quick: bool) -> str:
    sizes = [(n, 1000 * n) for n in (100, 300, 600, 1000)]
    rows = []
    for frames, tracks in sizes[:1] if quick else sizes:
        done = subprocess.run(
            [sys.executable, __file__, "--scale", str(frames), str(tracks)],
            stdout=subprocess.PIPE,
            text=True,
            check=True,
        )
        line = next(x for x in done.stdout.splitlines() if x.startswith("ROW|"))
        rows.append(line.split("|")[1:])
        print(rows[-1], flush=True)
    return markdown(
        [
            "frames",
            "tracks",
            "observations",
            "blocks",
            "factorization",
            "refinement",
            "covariance",
            "of both the reduced system s",
            "total s",
            "CPU s",
            "peak GB",
            "of it input GB",
            "rotation RMS deg",
        ],
        rows,
    )


TABLES: dict[str, tuple[str, Callable[[Path, bool], str]]] = {
    "optima": ("Published affine optima", table_optima),
    "efficiency": ("Statistical efficiency", table_efficiency),
    "colmap": ("The same tracks through pycolmap's expert set-up", table_colmap),
    "outliers": ("Wrong matches in the place of right ones", table_outliers),
    "added": ("Wrong matches beside the right ones", table_added),
    "ceres": ("Bundle adjustment against Ceres", table_ceres),
    "scale": ("Size", table_scale),
    "chain": ("Fine steps, short tracks", table_chain),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="*", choices=list(TABLES))
    parser.add_argument("--data", type=Path, default=Path(__file__).parents[1] / "../shared/data")
    parser.add_argument("--markdown", type=Path)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--scale", nargs=2, type=int, help=argparse.SUPPRESS)
    parser.add_argument("--colmap", type=Path, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.scale:
        run_scale(*args.scale)
        return
    if args.colmap:
        run_colmap(args.colmap)
        return
    for name in args.only or TABLES:
        title, make = TABLES[name]
        text = f"## {title}\n\n{make(args.data, args.quick)}\n"
        print(text, flush=True)
        if args.markdown:
            replace_section(args.markdown, title, text)


def replace_section(path: Path, title: str, text: str) -> None:
    """Put a table into the page, in the place of an older one of the same title; keep the rest."""
    mark = "<!-- tables: scripts/benchmark_geometry.py -->\n"
    before = path.read_text(encoding="utf-8") if path.is_file() else f"# The geometry\n\n{mark}"
    head, _, body = before.partition(mark)
    found = {part.splitlines()[0]: part for part in re.split(r"^## ", body, flags=re.M)[1:]}
    found[title] = text.removeprefix("## ").rstrip("\n") + "\n\n"
    order = [name for name, _ in TABLES.values() if name in found]
    tables = "".join(f"## {found[name]}" for name in order).rstrip("\n") + "\n"
    path.write_text(f"{head}{mark}\n{tables}", encoding="utf-8")


if __name__ == "__main__":
    main()
