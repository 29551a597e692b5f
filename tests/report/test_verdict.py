from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.geometry.rotations import rotation_from_vector
from semsfm_colmap.motion.check import check_tilt
from semsfm_colmap.motion.prior import TiltPrior
from semsfm_colmap.records import Reliability, TiltAgreement
from semsfm_colmap.report.metrics import compute_metrics
from semsfm_colmap.report.verdict import judge
from semsfm_colmap.types import DepthSign, SemMetadata, SemSeries
from tests.report.series import (
    cube,
    empty_reconstruction,
    make_inputs,
    make_reconstruction,
    written,
)

ANGLES = np.arange(10) * 4.0
BOTH = (written(), written("twin"))


def verdict(reconstruction, **more):
    return judge(compute_metrics(make_inputs(reconstruction, **more)))


def only_doubt(reconstruction, **more):
    doubts = verdict(reconstruction, **more).doubts
    assert len(doubts) == 1, doubts
    return doubts[0].sentence


def titles(result):
    return [doubt.title for doubt in result.doubts]


def facts(result):
    return " ".join((*result.measured, *result.trust))


def test_a_sound_series_leaves_no_doubt_and_says_its_facts():
    result = verdict(make_reconstruction(ANGLES), mesh=cube())
    assert result.doubts == ()
    text = facts(result)
    for part in ("10 of 10 images", "micrometres", "50.00 nm", "test chart", "36.00°", "nm in x"):
        assert part in text
    assert "Depth sign: resolved. The hand is right with 99\u202f% confidence." in text
    assert "visibility 99\u202f%" in text
    assert "a length that you know" in result.next[0]
    assert "12 faces in 1 component" in text


def with_tilts(angles, slope, sigma_deg):
    """Inputs with recorded tilts that the images contradict by a slope, as mapping judges them."""
    rec = make_reconstruction(angles)
    inputs = make_inputs(rec)
    tilts = np.deg2rad(np.asarray(angles) / slope)
    frames = tuple(
        replace(frame, metadata=SemMetadata(tilt_rad=tilt))
        for frame, tilt in zip(inputs.series.frames, tilts, strict=True)
    )
    prior = TiltPrior(
        image_names=rec.image_names,
        angle_rad=tilts,
        sigma_rad=np.full(len(tilts), np.deg2rad(sigma_deg)),
        axis_image_rad=None,
        source="a table",
    )
    check = check_tilt(prior, rec.image_names, rec.cameras.cam_from_world)
    tilt = TiltAgreement(
        source=prior.source,
        consistent=check.consistent,
        factor=check.factor,
        tolerance=check.tolerance,
    )
    return replace(inputs, series=SemSeries(frames=frames), tilt=tilt)


@pytest.mark.parametrize(("slope", "agrees"), [(1.0, True), (1.02, True), (0.835, False)])
def test_recorded_tilts_that_the_images_contradict_are_doubted(slope, agrees):
    result = judge(compute_metrics(with_tilts(ANGLES, slope, sigma_deg=0.2)))
    follows = [fact for fact in result.trust if "follow the recorded tilt" in fact]
    assert len(follows) == agrees
    assert len(result.doubts) == (not agrees)
    if not agrees:
        assert "turned 0.8350 times as far as the recorded tilts say" in result.doubts[0].sentence


def test_the_report_does_not_contradict_what_mapping_said_of_the_tilts():
    # over 20 degrees the images alone would tell 3 %, a stage with a sigma of 0.5 leaves 10 open
    inputs = with_tilts([-10.0, -5.0, 0.0, 5.0, 10.0], slope=1.06, sigma_deg=0.5)
    assert inputs.tilt.consistent
    assert inputs.tilt.tolerance == pytest.approx(0.104, abs=1e-3)
    metrics = compute_metrics(inputs)
    assert metrics.rotation.stage_tilt.slope == pytest.approx(1.06)
    assert metrics.rotation.stage_tilt.agrees is True
    result = judge(metrics)
    assert any("follow the recorded tilt with a slope of 1.060" in fact for fact in result.trust)
    assert not any("recorded tilts" in title for title in titles(result))


def test_tilts_that_mapping_did_not_compare_are_neither_followed_nor_doubted():
    inputs = replace(with_tilts(ANGLES, slope=0.835, sigma_deg=0.2), tilt=None)
    result = judge(compute_metrics(inputs))
    assert result.doubts == ()
    assert any("Against the recorded tilt, by which they were not" in fact for fact in result.trust)


def test_a_full_turn_is_named():
    text = facts(verdict(make_reconstruction(np.arange(36) * 10.0)))
    assert "full turn" in text
    assert "10.00°, against a median step of 10.00°" in text


def test_an_ambiguous_sign_is_doubted_with_its_evidence_and_twin():
    sign = DepthSign(
        status="ambiguous", confidence=0.6, evidence={"visibility": 0.6}, message="Say the tilt."
    )
    doubt = only_doubt(make_reconstruction(ANGLES, depth_sign=sign), models=BOTH)
    for part in ("ambiguous", "60\u202f% confidence", "visibility", "sparse/1"):
        assert part in doubt


def test_the_evidence_of_the_hand_is_said_once_and_a_users_word_beside_it():
    sign = DepthSign(
        status="resolved",
        confidence=0.97,
        evidence={"near side": 0.97},
        message="the hand is decided by visibility with confidence 0.97 (near side 0.97)",
    )
    fact = next(
        fact
        for fact in verdict(make_reconstruction(ANGLES, depth_sign=sign)).trust
        if fact.startswith("Depth sign")
    )
    assert fact.count("near side") == 1
    assert "0.970" not in fact
    given = replace(sign, evidence={"user": 1.0}, message="the hand was given by the user")
    result = verdict(make_reconstruction(ANGLES, depth_sign=given))
    assert "The hand (depth sign) is as you gave it." in facts(result)
    assert "user" not in facts(result)
    assert result.doubts == ()


def test_a_small_rotation_is_doubted():
    assert "only 8.00°" in only_doubt(make_reconstruction(np.arange(5) * 2.0))


def test_two_images_are_doubted():
    doubts = verdict(make_reconstruction([0.0, 20.0])).doubts
    assert any("Two parallel views" in doubt.sentence for doubt in doubts)


def test_a_wild_axis_is_doubted():
    rec = make_reconstruction(ANGLES)
    vectors = np.random.default_rng(0).normal(size=(10, 3))
    cameras = replace(rec.cameras, cam_from_world=rotation_from_vector(vectors))
    doubts = verdict(replace(rec, cameras=cameras)).doubts
    assert any("not about one axis" in doubt.sentence for doubt in doubts)


def test_missing_images_are_doubted_by_name():
    rec = make_reconstruction(ANGLES)
    lost = [f"lost {k}.png" for k in range(8)]
    doubt = only_doubt(rec, names=[*rec.image_names, *lost])
    assert "8 images could not be registered: lost 0.png, " in doubt
    assert doubt.endswith("lost 5.png and 2 more.")


def test_an_image_with_large_residuals_is_doubted_by_name():
    rec = make_reconstruction(ANGLES)
    xy = np.array(rec.observations.xy)
    xy[rec.observations.image_idx == 6] += 2.0
    rec = replace(rec, observations=replace(rec.observations, xy=xy))
    assert only_doubt(rec).endswith("frame_006.png.")


def test_a_spread_of_magnification_is_doubted():
    rec = make_reconstruction(ANGLES)
    scale = 20.0 + 0.1 * np.array([1, -1, -0.3, 0.7, -0.8, 0.9, -0.2, 0.4, 0.6, -0.9])
    doubts = verdict(replace(rec, cameras=replace(rec.cameras, scale_px_per_unit=scale))).doubts
    assert [doubt.title for doubt in doubts] == ["the magnification spreads over 1.00\u202f%"]


def test_a_weak_link_is_doubted():
    rec = make_reconstruction(ANGLES, num_points=400, window=2)
    obs = rec.observations
    before = np.zeros(len(rec.points), dtype=np.bool_)
    before[obs.track_idx[obs.image_idx <= 4]] = True
    inlier = ~(before[obs.track_idx] & (obs.image_idx > 4))
    doubts = verdict(replace(rec, inlier=inlier)).doubts
    assert any("frame_004.png – frame_005.png" in doubt.sentence for doubt in doubts)


def test_points_seen_twice_are_doubted():
    rec = make_reconstruction(ANGLES)
    place = np.arange(len(rec.inlier)) - np.searchsorted(
        rec.observations.track_idx, rec.observations.track_idx
    )
    doubts = verdict(replace(rec, inlier=place < 2)).doubts
    assert any("three or more images" in doubt.sentence for doubt in doubts)


def test_many_outliers_are_doubted():
    rec = make_reconstruction(ANGLES)
    inlier = np.random.default_rng(0).random(len(rec.inlier)) > 0.4
    assert "rejected as outliers" in only_doubt(replace(rec, inlier=inlier))


def test_a_pixel_size_that_contradicts_the_scale_is_doubted():
    doubt = only_doubt(make_reconstruction(ANGLES, pixel_size_um=0.06))
    assert "by a factor of 1.200" in doubt


def test_a_near_pinhole_is_doubted():
    near = written(max_deviation_px=3.0)
    assert "3.00 px" in only_doubt(make_reconstruction(ANGLES), models=(near,))


@pytest.mark.parametrize("num_images", [0, 1, 3])
def test_nothing_reconstructed_is_said_so(num_images):
    result = verdict(empty_reconstruction(num_images), names=["a", "b", "c"])
    assert any("There are no points" in doubt.sentence for doubt in result.doubts)


def trusted(total_deg=36.0, sigma_deg=0.1, depth_uncertainty=0.0, **parts):
    return Reliability(
        total_rotation_deg=total_deg,
        total_rotation_sigma_deg=sigma_deg,
        total_rotation_sigma_parts_deg={"noise": 0.01, **parts},
        depth_uncertainty=depth_uncertainty,
        best_model="scaled, prior",
        models=(),
    )


def judged(reliability, rec=None):
    inputs = make_inputs(make_reconstruction(ANGLES) if rec is None else rec)
    return judge(compute_metrics(replace(inputs, reliability=reliability)))


def test_values_are_given_to_the_digits_of_their_sigma():
    assert "turned through 36.00 ± 0.10°" in facts(judged(trusted()))
    assert "turned through 36 ± 3°" in facts(judged(trusted(sigma_deg=3.2)))


def test_models_that_disagree_by_a_fifth_are_doubted():
    (doubt,) = judged(trusted(depth_uncertainty=0.2)).doubts
    assert "by 20.0\u202f%" in doubt.sentence


def test_an_uncertain_rotation_is_doubted_with_its_largest_cause():
    (doubt,) = judged(trusted(sigma_deg=2.0, models=1.9)).doubts
    assert "36.0 ± 2.0" in doubt.sentence
    assert "the choice of the camera model" in doubt.sentence
    assert "known tilts" in doubt.action


def test_the_largest_doubt_comes_first():
    rec = replace(
        make_reconstruction(ANGLES),
        depth_sign=DepthSign(status="ambiguous", confidence=0.6, evidence={}),
    )
    found = judged(trusted(sigma_deg=2.0, depth_uncertainty=0.2), rec).doubts
    starts = ["The depth sign", "Camera models", "The total rotation"]
    assert [
        doubt.sentence[: len(start)] for doubt, start in zip(found, starts, strict=True)
    ] == starts


def test_without_error_bars_the_whole_model_is_in_doubt():
    none = replace(trusted(sigma_deg=0.0), total_rotation_sigma_parts_deg=None)
    assert "No error bars" in judged(none).doubts[0].sentence
