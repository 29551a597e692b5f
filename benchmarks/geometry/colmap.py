"""The same simulated databases through pycolmap's expert set-up."""

from __future__ import annotations

import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.geometry.colmap_mapping import map_with_colmap
from benchmarks.geometry.errors import aligned, errors
from benchmarks.geometry.series import SERIES, simulate, solve
from benchmarks.tables import table
from semsfm_colmap.geometry.rotations import depth_reversed, nearest_rotation, rotation_angle
from semsfm_colmap.refinement.refine import Refined
from semsfm_colmap.synthetic.tracks import SimulatedTracks
from semsfm_colmap.tracks.build import build_tracks
from semsfm_colmap.types import Float

COLMAP_ROWS = (
    # series, its tracks, share of wrong observations, seeds
    (SERIES[0], 6000, 0.0, 3),
    (SERIES[0], 15000, 0.1, 3),
    (SERIES[1], 600, 0.0, 6),
    (SERIES[2], 600, 0.0, 6),
    (SERIES[3], 600, 0.0, 6),
)
NOTE = (
    "The same verified matches (images up to ten apart) in one database: through this "
    "program's tracks, factorization and refinement, and through "
    "`pycolmap.incremental_mapping` with a fixed focal length of 1e5 px and the filter on "
    "focal lengths raised. RMS over the series of the rotation error in degrees and of "
    "the median point error relative to the size of the object; of COLMAP's model the "
    "better hand counts. Seconds are medians, without verifying the matches, and ours "
    "include reading the database and joining the tracks; in brackets processor time, which "
    "does not depend on what else the machine does."
)
HEAD = [
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
]


def make(data: Path, quick: bool) -> str:
    """The table; of COLMAP's random mapping a few seeds."""
    rows = []
    solve(simulate(SERIES[1], False, 0), False)  # compile
    for series, tracks, share, seeds in COLMAP_ROWS:
        figures, times, failed = [], [], 0
        for seed in range(min(seeds, 2) if quick else seeds):
            s = simulate(series._replace(tracks=tracks), False, seed, outlier_share=share)
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
                series.label,
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
    return f"{NOTE}\n\n{table(HEAD, rows)}"


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


def hand(fit: Refined, s: SimulatedTracks) -> Float:
    """(3,) factors that bring a fit into the hand of the truth."""
    _, T, _ = aligned(fit.cameras, fit.points, s.cameras.select(fit.images))
    return np.array([1.0, 1.0, np.sign(np.linalg.det(T))])


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


def structure_error(X: Float, true: Float) -> float:
    """Median distance after the best similarity, relative to the object's size [Umeyama 1991]."""
    a, b = X - np.median(X, axis=0), true - np.median(true, axis=0)
    good = np.ones(len(a), dtype=bool)
    for _ in range(5):
        a, b = a - a[good].mean(axis=0), b - b[good].mean(axis=0)
        Q = nearest_rotation(a[good].T @ b[good])
        a = a @ Q
        a *= np.sum(a[good] * b[good]) / np.sum(a[good] ** 2)
        # from now on without the points that are far off
        distance = np.linalg.norm(a - b, axis=1)
        good = distance <= 5.0 * np.median(distance)
    size = np.sqrt(np.mean(np.sum(b * b, axis=1)))
    return float(np.median(np.linalg.norm(a - b, axis=1)) / size)
