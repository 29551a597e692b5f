"""Which rungs the data rule out, and what the others' disagreement does to the error bars."""

from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.records import Rung
from semsfm_colmap.refinement.adjustment import BundleSettings
from semsfm_colmap.refinement.displaced import Displacement
from semsfm_colmap.refinement.model_choice import (
    SIZES_RUNG,
    ModelComparison,
    compare_models,
    judge,
    total_rotation,
)
from semsfm_colmap.refinement.model_spread import spread_of
from semsfm_colmap.refinement.options import RefinementOptions
from semsfm_colmap.refinement.refine import refine
from semsfm_colmap.refinement.trust import compare, total_rotation_parts, uncertainty_of
from semsfm_colmap.synthetic.tracks import simulate_tracks


def rung(name, range_deg, bic, held_out_px=float("nan")):
    return Rung(name=name, range_deg=range_deg, bic=bic, held_out_px=held_out_px, num_parameters=15)


THREE_IMAGES = (
    rung("orthographic", 9.0, 111_021.0),
    rung("scaled, prior", 12.0, 4_760.0),
    rung("scaled, free", 12.1, 4_752.0),
)


def test_where_nothing_is_held_out_the_bic_rules_out():
    found = judge(THREE_IMAGES, 0.5)
    assert found.alive == ("scaled, prior", "scaled, free")
    assert found.depth_uncertainty < 0.01
    assert not found.disagree


def test_where_the_bic_does_not_tell_all_rungs_stay():
    close = tuple(replace(r, bic=4_750.0 + k) for k, r in enumerate(THREE_IMAGES))
    assert len(judge(close, 0.1).alive) == 3


def test_held_out_residuals_come_first():
    rungs = (rung("orthographic", 9.0, 100.0, 0.30), rung("scaled, prior", 12.0, 900.0, 0.20))
    assert judge(rungs, 0.1).alive == ("scaled, prior",)


def comparison(rungs, sigma=0.1):
    found = judge(rungs, sigma)
    return replace(found, cameras={r.name: None for r in rungs})


def test_the_spread_is_half_of_what_the_rungs_alive_disagree_on():
    rungs = (rung("orthographic", 8.97, 1.0, 0.20), rung("scaled, prior", 10.95, 1.0, 0.20))
    assert spread_of(comparison(rungs), "scaled_orthographic").sigma_deg == pytest.approx(0.99)


def test_a_model_that_is_ruled_out_itself_is_off_by_its_whole_distance():
    rungs = (rung("scaled, prior", 42.0, 1.0, 0.40), rung("affine", 36.0, 1.0, 0.20))
    assert spread_of(comparison(rungs), "scaled_orthographic").sigma_deg == pytest.approx(6.0)


def test_rungs_that_agree_have_no_spread():
    assert spread_of(comparison((rung("scaled, prior", 42.0, 1.0, 0.40),)), "affine") is None


def small_tilt():
    """Four images at three degrees, whose magnification differs by as much as the prior lets it."""
    s = simulate_tracks(
        num_images=4,
        range_deg=9.0,
        num_tracks=400,
        noise_px=0.15,
        body="field",
        scale_drift=0.001,
        rng=np.random.default_rng(4),
    )
    rng = np.random.default_rng(0)
    fit = refine(s.cameras, np.arange(4), s.observations, RefinementOptions(), rng=rng).value
    return s, fit


def test_the_error_bars_of_a_small_tilt_hold_what_the_models_disagree_on():
    s, fit = small_tilt()
    heights = np.full(4, 1000.0)
    found = compare(fit, RefinementOptions(), heights)
    spread = spread_of(found, "scaled_orthographic")
    none = Displacement.none(4)
    before = uncertainty_of(fit, heights, none)
    after = uncertainty_of(fit, heights, none, comparison=found)
    parts = total_rotation_parts(fit, after)
    assert np.rad2deg(parts["models"]) == pytest.approx(spread.sigma_deg, rel=0.1)
    assert np.all(after.total.sigma_rotation_rad >= before.total.sigma_rotation_rad)
    # the points follow: their depths are as uncertain as the angles
    grown = np.trace(after.total.points - before.total.points, axis1=1, axis2=2)
    assert np.median(grown) > 0
    # the true angle lies within two standard deviations
    sigma = np.sqrt(sum(part**2 for part in parts.values()))
    true = total_rotation(np.asarray(s.cameras.cam_from_world))
    seen = total_rotation(np.asarray(fit.cameras.cam_from_world))
    assert abs(seen - true) < 2.0 * sigma


def test_frames_that_were_stretched_to_other_sizes_are_seen():
    s = simulate_tracks(
        num_images=7,
        range_deg=36.0,
        num_tracks=400,
        noise_px=0.15,
        body="body",
        rng=np.random.default_rng(5),
    )
    size = np.column_stack([np.full(7, 1000.0), 1000.0 * 0.98 ** np.arange(7)])
    obs = s.observations
    shrunk = replace(obs, xy=obs.xy * (size / 1000.0)[obs.image_idx])
    found: ModelComparison = compare_models(
        s.cameras, shrunk, BundleSettings(scale_sigma=0.03, sigma_px=0.15), size_px=size
    )
    assert found.alive == (SIZES_RUNG,)
    right = next(r for r in found.rungs if r.name == SIZES_RUNG).range_deg
    true = np.rad2deg(total_rotation(np.asarray(s.cameras.cam_from_world)))
    assert right == pytest.approx(true, abs=0.2)
    spread = spread_of(found, "scaled_orthographic")
    written = next(r for r in found.rungs if r.name == "scaled, prior").range_deg
    assert abs(written - true) < 1.5 * spread.sigma_deg
