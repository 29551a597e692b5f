import numpy as np
import pytest

from semsfm_colmap.geometry.epipolar import (
    epipolar_residual,
    estimate_affine_fundamental,
    fundamental_from_hyperplane,
    hyperplane_from_fundamental,
)
from semsfm_colmap.synthetic.tracks import simulate_tracks


def two_views(noise_px: float, num: int = 500):
    s = simulate_tracks(
        num_images=2,
        range_deg=12,
        num_tracks=num,
        noise_px=noise_px,
        body="field",
        rng=np.random.default_rng(5),
    )
    xy = s.observations.xy.reshape(-1, 2, 2)
    return xy[:, 0], xy[:, 1]


def test_exact_correspondences_satisfy_the_constraint_and_the_bilinear_form():
    xy1, xy2 = two_views(0.0)
    F = estimate_affine_fundamental(xy1, xy2)
    assert np.allclose(epipolar_residual(F, xy1, xy2), 0.0, atol=1e-8)
    h1, h2 = (np.column_stack([x, np.ones(len(x))]) for x in (xy1, xy2))
    assert np.allclose(np.einsum("li,ij,lj->l", h2, F, h1), 0.0, atol=1e-8)
    assert np.all(F[:2, :2] == 0.0)


def test_residuals_have_the_standard_deviation_of_the_noise_from_both_sides():
    xy1, xy2 = two_views(0.4, num=4000)
    r = epipolar_residual(estimate_affine_fundamental(xy1, xy2), xy1, xy2)
    assert 0.37 < np.std(r) < 0.43


def test_hyperplane_and_fundamental_are_inverse():
    n, e = np.array([0.5, -0.5, 0.1, 0.7]), 3.0
    n /= np.linalg.norm(n)
    back, offset = hyperplane_from_fundamental(fundamental_from_hyperplane(n, e))
    assert np.allclose(back, n)
    assert np.isclose(offset, e)


def test_three_matches_are_too_few():
    with pytest.raises(ValueError, match="L >= 4"):
        estimate_affine_fundamental(np.zeros((3, 2)), np.zeros((3, 2)))
