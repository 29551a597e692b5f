"""Published affine optima, from the one start of the camera basis constraints."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np

from benchmarks.tables import table
from semsfm_colmap.factorization.blocks import select_blocks
from semsfm_colmap.factorization.cbc import factorize_cbc
from semsfm_colmap.factorization.options import FactorizationOptions
from semsfm_colmap.factorization.polish import polish_affine
from semsfm_colmap.geometry.eliminated import SolverOptions
from semsfm_colmap.geometry.points import residuals, solve_points, track_pointer
from semsfm_colmap.types import AffineModel, Observations

OPTIMA_PX = {"dinosaur trimmed": 1.270153, "dinosaur full": 1.217574, "house": 2.750877}


HEAD = ["set", "size", "CBC px", "polished px", "published px", "difference", "steps", "s"]


def make(data: Path, quick: bool) -> str:
    """The table; a first run of each set compiles."""
    rows = []
    for name, optimum in OPTIMA_PX.items():
        obs = read_tracks(data / "tracks", name)
        affine_optimum(obs)
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
    return table(HEAD, rows)


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
    assert polish.value is not None
    return (
        float(np.sqrt(np.mean(r**2))),
        polish.value.rms_px,
        polish.iterations,
        time.monotonic() - begin,
    )


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
    seen = np.asarray(np.isfinite(xy).all(axis=2))
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
