"""The geometry at its limit: every table of docs/benchmark_geometry.md.

usage: benchmark_geometry.py [--only NAME ...] [--data FOLDER] [--markdown FILE] [--quick]

optima      affine optima of published track sets from the one CBC start
efficiency  errors of simulated series against the Cramer-Rao bound, and normalised errors
colmap      the same simulated databases through pycolmap's expert set-up
outliers    wrong matches of 10, 20, 30 %
scale       up to 1000 frames and 8 million observations: seconds and peak memory
ceres       bundle adjustment against Ceres (pycolmap) on one model to the same cost

Times are of one run on a shared machine: compare rows of a table, never runs.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from semsfm_colmap.factorization.blocks import select_blocks
from semsfm_colmap.factorization.cbc import factorize_cbc
from semsfm_colmap.factorization.factorize import factorize, find_parts
from semsfm_colmap.factorization.options import FactorizationOptions
from semsfm_colmap.factorization.polish import polish_affine
from semsfm_colmap.geometry.eliminated import Eliminated, SolverOptions
from semsfm_colmap.geometry.points import residuals, solve_points, track_pointer
from semsfm_colmap.geometry.rotations import (
    depth_reversed,
    nearest_rotation,
    rotation_angle,
    rotation_from_vector,
    vector_from_rotation,
)
from semsfm_colmap.refinement.bundle import BundleModel, bundle_adjust
from semsfm_colmap.refinement.covariance import estimate_covariance
from semsfm_colmap.refinement.options import RefinementOptions
from semsfm_colmap.refinement.refine import refine
from semsfm_colmap.synthetic.tracks import SimulatedTracks, simulate_tracks
from semsfm_colmap.types import AffineModel, Observations, OrthographicCameras

OPTIMA_PX = {"dinosaur trimmed": 1.270153, "dinosaur full": 1.217574, "house": 2.750877}
SERIES = (
    # frames, range, tracks, body, window
    (60, 180.0, 2000, "body", 10),
    (7, 30.0, 600, "field", 0),
    (5, 12.0, 600, "field", 0),
    (3, 10.0, 600, "field", 0),
)
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
    start = factorize(part, s.observations, factorization, rng)
    assert start.value is not None, start.message
    options = RefinementOptions(
        camera_model="orthographic" if known_scale else "scaled_orthographic"
    )
    fit = refine(start.value[0], part.images, s.observations, options, rng=rng)
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
    count = 5 if quick else 25
    rows = []
    for series in SERIES:
        for known in (True, False):
            error2 = bound2 = point2 = point_bound2 = 0.0
            normalised, point_normalised = [], []
            for seed in range(count):
                s = simulate(series, known, seed)
                fit = solve(s, known)
                bound = cramer_rao(s, known)
                R, T, X = aligned(fit.cameras, fit.points, s.cameras.select(fit.images))
                R_true = np.asarray(s.cameras.cam_from_world)[fit.images]
                w = vector_from_rotation(R @ R_true.mT)
                error2 += float(np.mean(np.sum(w * w, axis=1)))
                bound2 += float(np.mean(np.sum(bound.sigma_rotation_rad**2, axis=1)))
                d = X - np.asarray(s.points)[fit.tracks]
                C_true = bound.points[fit.tracks]
                weight = 1.0 / np.trace(C_true, axis1=1, axis2=2)
                point2 += float(np.mean(weight * np.sum(d * d, axis=1)))
                point_bound2 += 1.0
                own = estimate_covariance(fit.model, fit.state, fit.observations, fit.sigma_px)
                assert own.value is not None
                normalised.append(np.mean((w / own.value.sigma_rotation_rad) ** 2))
                C = T.T @ own.value.points @ T
                mahalanobis = np.einsum("ni,nij,nj->n", d, np.linalg.inv(C), d) / 3.0
                point_normalised.append(np.mean(mahalanobis))
            rows.append(
                [
                    f"{series[0]} / {series[1]:g} deg",
                    "known" if known else "prior",
                    count,
                    f"{np.rad2deg(np.sqrt(error2 / count)):.4f}",
                    f"{np.sqrt(error2 / bound2):.3f}",
                    f"{np.sqrt(point2 / point_bound2):.3f}",
                    f"{np.mean(normalised):.3f}",
                    f"{np.mean(point_normalised):.3f}",
                ]
            )
            print(rows[-1], flush=True)
    return markdown(
        [
            "frames / range",
            "scale",
            "series",
            "rotation RMS deg",
            "rotation / bound",
            "points / bound",
            "normalised rotation^2",
            "normalised points^2",
        ],
        rows,
    )


def errors(fit: Any, s: SimulatedTracks) -> tuple[float, float]:
    """RMS rotation error in deg and RMS point error relative to the object's size."""
    R, _, X = aligned(fit.cameras, fit.points, s.cameras.select(fit.images))
    angle = rotation_angle(R @ np.asarray(s.cameras.cam_from_world)[fit.images].mT)
    d = X - np.asarray(s.points)[fit.tracks]
    size = np.sqrt(np.mean(np.sum((s.points - s.points.mean(axis=0)) ** 2, axis=1)))
    rms = np.sqrt(np.median(np.sum(d * d, axis=1)))
    return float(np.rad2deg(np.sqrt(np.mean(angle**2)))), float(rms / size)


def table_outliers(data: Path, quick: bool) -> str:
    rows = []
    count = 3 if quick else 10
    for series in SERIES[:3]:
        clean = None
        for share in (0.0, 0.1, 0.2, 0.3):
            figures = []
            for seed in range(count):
                s = simulate(series, False, seed, outlier_share=share)
                figures.append(errors(solve(s, False), s))
            rotation, structure = np.sqrt(np.mean(np.square(figures), axis=0))
            clean = clean or (rotation, structure)
            rows.append(
                [
                    f"{series[0]} / {series[1]:g} deg",
                    f"{share:.0%}",
                    f"{rotation:.4f}",
                    f"{rotation / clean[0]:.2f}",
                    f"{100 * structure:.4f} %",
                    f"{structure / clean[1]:.2f}",
                ]
            )
            print(rows[-1], flush=True)
    return markdown(
        ["frames / range", "wrong", "rotation deg", "to clean", "points", "to clean"], rows
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


def map_with_colmap(s: SimulatedTracks, focal_px: float) -> tuple[Any, float]:
    """The expert set-up: fixed long focal length, raised filter; model, seconds of mapping."""
    from semsfm_colmap.colmap.library import pycolmap

    with tempfile.TemporaryDirectory() as folder:
        database = Path(folder) / "database.db"
        write_database(s, database, focal_px)
        pairs = Path(folder) / "pairs.txt"
        M = len(s.cameras)
        pairs.write_text(
            "".join(
                f"{i:04d}.png {j:04d}.png\n" for i in range(M) for j in range(i + 1, min(i + 11, M))
            )
        )
        pycolmap.verify_matches(str(database), str(pairs))
        options = pycolmap.IncrementalPipelineOptions()
        options.ba_refine_focal_length = False
        options.ba_refine_extra_params = False
        options.max_focal_length_ratio = 1e9
        options.mapper.max_focal_length_ratio = 1e9
        options.triangulation.max_focal_length_ratio = 1e9
        begin = time.monotonic()
        models = pycolmap.incremental_mapping(str(database), folder, folder, options=options)
        seconds = time.monotonic() - begin
        if not models:
            return None, seconds
        return max(models.values(), key=lambda m: m.num_reg_images()), seconds


def colmap_errors(model: Any, s: SimulatedTracks) -> float:
    """RMS rotation error in deg of the better hand."""
    images = sorted((i for i in model.images.values() if i.has_pose), key=lambda i: i.name)
    R = np.array([np.asarray(i.cam_from_world().matrix())[:, :3] for i in images])
    idx = np.array([int(Path(i.name).stem) for i in images])
    R_true = np.asarray(s.cameras.cam_from_world)[idx]
    best = []
    for candidate in (R, depth_reversed(R)):
        Q = nearest_rotation(np.einsum("mji,mjk->ik", candidate, R_true))
        angle = rotation_angle(candidate @ Q @ R_true.mT)
        best.append(float(np.rad2deg(np.sqrt(np.mean(angle**2)))))
    return min(best)


def table_colmap(data: Path, quick: bool) -> str:
    rows = []
    solve(simulate(SERIES[1], False, 0), False)  # compile
    for series in SERIES:
        large = (series[0], series[1], 6000 if series[0] == 60 else series[2], *series[3:])
        s = simulate(large, False, 0)
        begin = time.monotonic()
        fit = solve(s, False)
        ours = time.monotonic() - begin
        model, seconds = map_with_colmap(s, 1e5)
        rotation, _ = errors(fit, s)
        rows.append(
            [
                f"{series[0]} / {series[1]:g} deg",
                f"{len(fit.images)} / {series[0]}",
                f"{rotation:.4f}",
                f"{ours:.2f}",
                "-" if model is None else f"{model.num_reg_images()} / {series[0]}",
                "-" if model is None else f"{colmap_errors(model, s):.4f}",
                f"{seconds:.2f}",
                f"{seconds / ours:.1f}",
            ]
        )
        print(rows[-1], flush=True)
    return markdown(
        [
            "frames / range",
            "ours: images",
            "rotation deg",
            "map s",
            "COLMAP expert: images",
            "rotation deg",
            "map s",
            "times faster",
        ],
        rows,
    )


def table_ceres(data: Path, quick: bool) -> str:
    """Both start from the same disturbed cameras and points and end at the same cost."""
    from semsfm_colmap.colmap.library import pycolmap
    from semsfm_colmap.colmap.telecentric import pinhole_translations

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
        T = pinhole_translations(start, focal, np.full((60, 2), size / 2.0))
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


def long_series(frames: int, tracks: int, length: int, seed: int = 0) -> SimulatedTracks:
    """A turn, tracks of a fixed length, made without a dense visibility matrix.

    Fine steps do not make tracks last longer in degrees: a track has its observations in some of
    the frames of a run of `TRACK_SPAN_DEG`.
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
    window = max(length, round(frames * TRACK_SPAN_DEG / 360.0))
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


def peak_gb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20


def run_scale(frames: int, tracks: int) -> None:
    """One size in a process of its own, so that the peak memory is its own."""
    solve(simulate(SERIES[1], False, 0), False)  # compile
    s = long_series(frames, tracks, 8)
    obs, base = s.observations, peak_gb()
    rng = np.random.default_rng(0)
    times, memory = [], []
    begin = time.monotonic()

    def lap() -> None:
        nonlocal begin
        times.append(time.monotonic() - begin)
        memory.append(peak_gb())
        begin = time.monotonic()

    options = FactorizationOptions()
    part = find_parts(obs, options)[0]
    lap()
    start = factorize(part, obs, options, rng)
    assert start.value is not None, start.message
    lap()
    fit = refine(start.value[0], part.images, obs, RefinementOptions(), rng=rng)
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
        f"{sum(times):.0f}",
        f"{max(memory):.1f}",
        f"{base:.1f}",
        f"{rotation:.4f}",
    ]
    print("ROW|" + "|".join(str(c) for c in cells), flush=True)


def table_scale(data: Path, quick: bool) -> str:
    sizes = [(100, 100_000), (300, 300_000), (1000, 1_000_000)]
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
            "total s",
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
    "outliers": ("Wrong matches", table_outliers),
    "ceres": ("Bundle adjustment against Ceres", table_ceres),
    "scale": ("Size", table_scale),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="*", choices=list(TABLES))
    parser.add_argument("--data", type=Path, default=Path(__file__).parents[1] / "../shared/data")
    parser.add_argument("--markdown", type=Path)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--scale", nargs=2, type=int, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.scale:
        run_scale(*args.scale)
        return
    sections = []
    for name in args.only or TABLES:
        title, make = TABLES[name]
        text = f"## {title}\n\n{make(args.data, args.quick)}\n"
        print(text, flush=True)
        sections.append(text)
    if args.markdown:
        head = "# The geometry, measured\n\nMade by `scripts/benchmark_geometry.py`.\n\n"
        args.markdown.write_text(head + "\n".join(sections), encoding="utf-8")


if __name__ == "__main__":
    main()
