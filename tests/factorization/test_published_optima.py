"""Affine optima published by Hong, Zach, Fitzgibbon and Cipolla, ECCV 2016, table 7."""

import numpy as np
import pytest
from scipy.io import loadmat

from semsfm_colmap.factorization.blocks import select_blocks
from semsfm_colmap.factorization.cbc import factorize_cbc
from semsfm_colmap.factorization.options import FactorizationOptions
from semsfm_colmap.factorization.polish import polish_affine
from semsfm_colmap.geometry.eliminated import SolverOptions
from semsfm_colmap.geometry.points import solve_points, track_pointer
from semsfm_colmap.types import AffineModel
from tests.factorization.measurements import observations_from_matrix

pytestmark = pytest.mark.data


def read(data_path, name):
    folder = data_path / "tracks"
    if name == "dinosaur full":
        table = np.loadtxt(folder / "dinosaur_viff.xy")
        table[table == -1] = np.nan
        return table.T
    content = loadmat(folder / f"{name.replace(' ', '_')}.mat")
    return np.where(content["W"] != 0, content["M"], np.nan).astype(float)


@pytest.mark.parametrize(
    ("name", "optimum_px", "gauge"),
    [
        ("dinosaur trimmed", 1.270153, "orthonormal"),
        ("dinosaur trimmed", 1.270153, "two_cameras"),
        ("dinosaur full", 1.217574, "orthonormal"),
        ("house", 2.750877, "orthonormal"),
        ("house", 2.750877, "two_cameras"),
    ],
)
def test_cbc_and_polish_reach_the_best_known_optimum(data_path, name, optimum_px, gauge):
    obs = observations_from_matrix(read(data_path, name))
    options = FactorizationOptions(block_ransac_trials=0, gauge=gauge)
    start = factorize_cbc(
        select_blocks(obs, options), obs.num_images, options, np.random.default_rng(0)
    )
    assert start.value is not None
    A, t = start.value.A, start.value.t
    pointer = track_pointer(obs.track_idx, obs.num_tracks)
    X = solve_points(A, t, obs.image_idx, pointer, obs.xy, np.ones(len(obs)))
    polish = polish_affine(
        AffineModel(A=A, t=t, X=X),
        obs,
        solver=SolverOptions(max_iterations=300, cost_tolerance=1e-12),
    )
    assert polish.status == "ok"
    assert polish.value.rms_px == pytest.approx(optimum_px, rel=1e-6)
