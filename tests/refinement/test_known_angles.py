import numpy as np
import pytest

from semsfm_colmap.factorization.options import FactorizationOptions
from semsfm_colmap.mapping.parts import map_observations
from semsfm_colmap.motion.prior import TiltPrior
from semsfm_colmap.refinement.adjustment import BundleSettings
from semsfm_colmap.refinement.bundle import BundleModel, bundle_adjust
from semsfm_colmap.refinement.known_angles import angle_prior
from semsfm_colmap.refinement.options import RefinementOptions
from semsfm_colmap.synthetic.tracks import simulate_tracks
from tests.alignment import best_hand_errors_deg, rotation_errors_deg
from tests.oracles.geometry import numeric_jacobian


def small_tilt(seed=0, num_images=5, range_deg=8.0):
    return simulate_tracks(
        num_images=num_images,
        range_deg=range_deg,
        num_tracks=150,
        body="field",
        noise_px=0.5,
        wobble_deg=0.05,
        scale_drift=0.001,
        rng=np.random.default_rng(seed),
    )


def known(s, factor=1.0, range_deg=8.0):
    M = len(s.cameras)
    angle = np.deg2rad(np.linspace(-range_deg / 2, range_deg / 2, M)) * factor
    return angle, np.full(M, np.deg2rad(0.05))


def test_derivatives_agree_with_finite_differences():
    s = small_tilt()
    prior = angle_prior(*known(s))
    model = BundleModel.build(
        5, free_scale=True, free_affine=False, scale_sigma=0.01, affine_sigma=0.01, angles=prior
    )
    r, J = model.prior(s.cameras)
    numeric = numeric_jacobian(
        lambda step: model.prior(model.retract(s.cameras, step))[0], np.zeros(model.num_params)
    )
    assert len(r) == 5 + len(prior.pairs)
    assert np.allclose(J.toarray(), numeric, atol=1e-4 * np.abs(numeric).max())


def test_right_angles_make_a_small_tilt_accurate():
    errors = {False: [], True: []}
    for seed in range(6):
        s = small_tilt(seed)
        for use in errors:
            fit = bundle_adjust(
                s.cameras,
                s.observations,
                BundleSettings(sigma_px=0.5, scale_sigma=0.001),
                angles=angle_prior(*known(s)) if use else None,
            )
            R = fit.value.cameras.cam_from_world
            errors[use].append(np.median(best_hand_errors_deg(R, s.cameras.cam_from_world)))
    assert np.mean(errors[True]) < 0.8 * np.mean(errors[False])


def test_unknown_or_equal_angles_are_no_prior():
    assert angle_prior(np.full(5, np.nan), np.full(5, 0.01)) is None
    assert angle_prior(np.full(5, 0.3), np.full(5, 0.01)) is None
    partly = angle_prior(np.array([0.0, np.nan, 0.2, 0.4]), np.full(4, 0.01))
    assert 1 not in partly.pairs


@pytest.mark.parametrize(("factor", "used"), [(1.0, True), (1.2, False)])
def test_a_table_is_used_when_the_images_agree_and_named_when_they_do_not(factor, used):
    s = simulate_tracks(
        num_images=9,
        range_deg=60.0,
        num_tracks=500,
        body="field",
        wobble_deg=0.1,
        rng=np.random.default_rng(3),
    )
    names = tuple(f"{i}.png" for i in range(9))
    angle, sigma = known(s, factor, 60.0)
    prior = TiltPrior(
        image_names=names, angle_rad=angle, sigma_rad=sigma, axis_image_rad=None, source="a table"
    )
    result = map_observations(
        s.observations,
        names,
        np.full((9, 2), 1000),
        factorization=FactorizationOptions(),
        refinement=RefinementOptions(),
        tilt=prior,
    )
    figures = result.value[0].figures
    assert figures.diagnostics.tilt.consistent is used
    assert any("the angles changed by" in n for n in figures.notes) is used
    R = result.value[0].reconstruction.cameras.cam_from_world
    assert best_hand_errors_deg(R, s.cameras.cam_from_world).max() < 0.2


def test_a_known_direction_of_the_tilt_decides_the_hand():
    s = simulate_tracks(
        num_images=7,
        range_deg=40.0,
        num_tracks=400,
        body="field",
        wobble_deg=0.1,
        rng=np.random.default_rng(3),
    )
    names = tuple(f"{i}.png" for i in range(7))
    angle, sigma = known(s, 1.0, 40.0)
    prior = TiltPrior(
        image_names=names, angle_rad=angle, sigma_rad=sigma, axis_image_rad=None, source="a table"
    )
    # a right-handed turn about +y takes z to x: the left edge recedes
    for edge, right in (("left", True), ("right", False)):
        result = map_observations(
            s.observations,
            names,
            np.full((7, 2), 1000),
            factorization=FactorizationOptions(),
            refinement=RefinementOptions(receding_edge=edge),
            tilt=prior,
        )
        model = result.value[0].reconstruction
        R_true = np.asarray(s.cameras.cam_from_world)
        R = np.asarray(model.cameras.cam_from_world)
        fits = np.median(rotation_errors_deg(R, R_true)) < 1.0
        assert model.depth_sign.status == "resolved"
        assert bool(fits) is right
