"""Simulated series of other magnifications through the mapping of a part."""

import numpy as np

from semsfm_colmap.factorization.options import FactorizationOptions
from semsfm_colmap.geometry.threads import blas_threads
from semsfm_colmap.mapping.parts import map_observations
from semsfm_colmap.refinement.options import RefinementOptions
from semsfm_colmap.synthetic.tracks import simulate_tracks
from tests.alignment import best_hand_errors_deg


def test_images_of_other_magnifications_are_mapped_with_a_prior_as_wide_and_it_is_said():
    s = simulate_tracks(
        num_images=10,
        range_deg=50.0,
        num_tracks=500,
        noise_px=0.2,
        body="field",
        scale_drift=0.03,
        rng=np.random.default_rng(0),
    )
    said = []
    end = map_observations(
        s.observations,
        tuple(f"{i}.png" for i in range(10)),
        np.full((10, 2), 1000),
        factorization=FactorizationOptions(),
        refinement=RefinementOptions(),
        note=said.append,
    )
    (part,) = end.value
    cameras = part.reconstruction.cameras
    errors = best_hand_errors_deg(cameras.cam_from_world, s.cameras.cam_from_world)
    assert np.median(errors) < 0.05
    ratio = cameras.scale_px_per_unit / s.cameras.scale_px_per_unit
    assert np.std(np.log(ratio)) < 3e-4
    assert any("magnification differs" in note for note in part.figures.notes)
    assert any("with a prior as wide" in sentence for sentence in said)
    assert part.figures.reliability.total_rotation_sigma_parts_deg["noise"] > 0


def test_the_number_of_threads_of_linear_algebra_makes_no_difference_to_a_bit():
    simulated = simulate_tracks(
        num_images=7, range_deg=40, num_tracks=2000, noise_px=0.2, rng=np.random.default_rng(3)
    )
    found = []
    for threads in (1, 2):
        with blas_threads(threads):
            end = map_observations(
                simulated.observations,
                tuple(f"{i}.png" for i in range(7)),
                np.full((7, 2), 1000),
                factorization=FactorizationOptions(),
                refinement=RefinementOptions(),
            )
        r = end.value[0].reconstruction
        found.append(
            (
                r.points,
                r.cameras.cam_from_world,
                r.sigma_rotation_rad,
                r.sigma_scale,
                r.point_covariance,
            )
        )
    for one, two in zip(*found, strict=True):
        np.testing.assert_array_equal(one, two)
