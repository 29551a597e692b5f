"""The width of the magnification's prior, from simulated series."""

from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.refinement.magnification import magnification_notes, magnification_sigma
from semsfm_colmap.refinement.options import RefinementOptions
from semsfm_colmap.refinement.refine import refine
from semsfm_colmap.synthetic.tracks import simulate_tracks
from tests.alignment import best_hand_errors_deg

OPTIONS = RefinementOptions()


def series(scale_drift, num_images=10, range_deg=50.0, seed=0):
    s = simulate_tracks(
        num_images=num_images,
        range_deg=range_deg,
        num_tracks=500,
        noise_px=0.2,
        body="field",
        scale_drift=scale_drift,
        rng=np.random.default_rng(seed),
    )
    images = np.arange(num_images)

    def fitted(options=OPTIONS):
        return refine(
            s.cameras, images, s.observations, options, rng=np.random.default_rng(0)
        ).value

    return s, fitted


@pytest.mark.parametrize("range_deg", [9.0, 50.0])
def test_a_microscope_left_alone_keeps_the_narrow_prior(range_deg):
    _, fitted = series(0.0005, range_deg=range_deg, num_images=6)
    assert magnification_sigma(fitted(), OPTIONS) == OPTIONS.scale_sigma


@pytest.mark.parametrize(("drift", "allowed"), [(0.01, (0.01,)), (0.03, (0.01, 0.03))])
def test_images_of_other_magnifications_widen_it(drift, allowed):
    _, fitted = series(drift)
    assert magnification_sigma(fitted(), OPTIONS) in allowed


def test_with_the_width_of_the_series_the_angles_come_out_right():
    s, fitted = series(0.03)
    narrow = fitted()
    wide = fitted(replace(OPTIONS, scale_sigma=magnification_sigma(narrow, OPTIONS)))
    true = s.cameras.cam_from_world
    before = np.median(best_hand_errors_deg(narrow.cameras.cam_from_world, true))
    after = np.median(best_hand_errors_deg(wide.cameras.cam_from_world, true))
    assert after < min(0.05, 1.01 * before)


def test_a_fixed_width_stays():
    _, fitted = series(0.03)
    fixed = replace(OPTIONS, magnification="fixed")
    assert magnification_sigma(fitted(), fixed) == OPTIONS.scale_sigma


def test_what_differs_is_said():
    same = np.full((3, 2), 500.0)
    assert magnification_notes(np.ones(3), same, estimated=False) == []
    (note,) = magnification_notes(np.array([1.0, 1.03, 0.98]), same, estimated=True)
    assert "5.0 %" in note
    other = np.array([[500.0, 400.0], [500.0, 390.0]])
    (note,) = magnification_notes(np.ones(2), other, estimated=False)
    assert "from 500 x 390 to 500 x 400 px" in note
