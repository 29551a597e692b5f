from __future__ import annotations

import numpy as np

from semsfm_colmap.exports.cloud import point_covariance
from tests.exports.ball_project import ball, image_names


def test_point_deviations_are_those_of_repeated_measurements() -> None:
    """Cameras held fixed, 200 draws of the noise: the scatter of the points is the stated sigma."""
    made = ball(image_names(False), num_points=60)
    stated = point_covariance(made)
    rng = np.random.default_rng(0)
    obs = made.observations
    A = made.cameras.projection[obs.image_idx]
    H = np.zeros((len(made.points), 3, 3))
    np.add.at(H, obs.track_idx, np.einsum("oki,okj->oij", A, A))
    r = made.residuals()
    noise = np.sqrt(np.sum(r**2) / (2 * len(obs) - 3 * len(made.points)))
    moves = []
    for _ in range(200):
        b = np.zeros((len(made.points), 3))
        np.add.at(b, obs.track_idx, np.einsum("oki,ok->oi", A, noise * rng.normal(size=r.shape)))
        moves.append(np.linalg.solve(H, b[:, :, None])[:, :, 0])
    scatter = np.mean(np.square(moves), axis=0)
    ratio = np.sqrt(scatter.sum(axis=1) / np.trace(stated, axis1=1, axis2=2))
    assert 0.97 < np.median(ratio) < 1.03
