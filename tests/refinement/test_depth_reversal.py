from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.errors import UsageError
from semsfm_colmap.geometry.rotations import depth_reversed, rotation_from_vector
from semsfm_colmap.refinement.depth_reversal import (
    Cue,
    apply_user_word,
    axis_from_receding_edge,
    decide_depth_sign,
    known_tilt_cue,
    reverse_depth,
    visibility_cues,
)
from semsfm_colmap.refinement.depth_reversal.cue import cue_from_t, region_t
from semsfm_colmap.refinement.depth_reversal.decision import told
from semsfm_colmap.synthetic.occluded_tracks import (
    OccludedTracksOptions,
    noise_scene,
    simulate_occluded,
)
from semsfm_colmap.synthetic.tracks import simulate_tracks
from semsfm_colmap.types import DepthSign, OrthographicCameras

CONVEX, OPAQUE = ("near side", "bulge"), ("occlusion order", "covered steps")


def occluded(shape, range_deg, num_images, seed=0, **options):
    made = OccludedTracksOptions(
        shape=shape, range_deg=range_deg, num_images=num_images, num_points=3000, **options
    )
    return simulate_occluded(made, np.random.default_rng(seed))


def cues_of(scene, reverse=False):
    cameras, points = scene.cameras, scene.points
    if reverse:
        cameras, points = reverse_depth(cameras, points)
    return visibility_cues(cameras, points, scene.observations, scene.image_size_px)


def tilted_cameras(angle_rad, axis):
    R = rotation_from_vector(np.asarray(angle_rad)[:, None] * axis)
    return OrthographicCameras(
        cam_from_world=R,
        scale_px_per_unit=np.ones(len(R)),
        translation_px=np.zeros((len(R), 2)),
    )


def cue(logit):
    return cue_from_t(logit, 48, 1.0, 9.0)


def test_a_body_has_the_hand_in_which_the_seen_side_is_near_and_its_twin_is_reversed():
    s = simulate_tracks(
        num_images=30,
        range_deg=180,
        num_tracks=3000,
        track_window=8,
        rng=np.random.default_rng(7),
    )
    sizes = np.full((30, 2), 1000)
    for reverse in (False, True):
        cameras, points = reverse_depth(s.cameras, s.points) if reverse else (s.cameras, s.points)
        cues = visibility_cues(cameras, points, s.observations, sizes)
        sign, turn = decide_depth_sign(cues, 0.95)
        assert turn is reverse
        assert sign.status == "resolved"
        assert sign.confidence > 0.99
    assert np.allclose(
        depth_reversed(np.array(reverse_depth(s.cameras, s.points)[0].cam_from_world)),
        s.cameras.cam_from_world,
    )


def test_a_field_that_is_seen_everywhere_leaves_the_hand_open():
    s = simulate_tracks(
        num_images=7, range_deg=30, num_tracks=1000, body="field", rng=np.random.default_rng(3)
    )
    cues = visibility_cues(s.cameras, s.points, s.observations, np.full((7, 2), 1000))
    sign, _ = decide_depth_sign(cues, 0.95)
    assert sign.status == "ambiguous"
    assert "both models" in sign.message


@pytest.mark.parametrize("shape", ["clump", "substrate"])
def test_every_cue_changes_its_sign_under_reversal_and_nothing_else(shape):
    scene = occluded(shape, 70.0, 15)
    right, twin = cues_of(scene), cues_of(scene, reverse=True)
    assert max(abs(c.t) for c in right.values()) > 2.0
    for name in right:
        assert twin[name].t == pytest.approx(-right[name].t, abs=1e-9)
        assert twin[name].probability == pytest.approx(1.0 - right[name].probability, abs=1e-9)
        assert twin[name].num_regions == right[name].num_regions


@pytest.mark.parametrize("shape", ["bumpy", "spiny", "clump"])
@pytest.mark.parametrize("range_deg", [40.0, 180.0])
def test_closed_bodies_are_resolved_with_the_right_hand(shape, range_deg):
    scene = occluded(shape, range_deg, 20, track_length_deg=30.0)
    sign, reverse = decide_depth_sign(cues_of(scene), 0.95)
    assert not reverse
    assert sign.status == "resolved"


def test_bodies_on_a_substrate_are_resolved_by_what_they_hide_not_by_their_roundness():
    scene = occluded("substrate", 75.0, 26, seed=3, track_length_deg=30.0)
    cues = cues_of(scene)
    assert all(cues[name].probability == 0.5 for name in CONVEX)
    assert cues["covered steps"].t > 2.0
    assert not decide_depth_sign(cues, 0.95)[1]


def test_a_patch_of_a_field_cut_out_by_a_mask_does_not_pass_for_a_body():
    scene = occluded("crater", 40.0, 15)
    obs = scene.observations
    kept = np.linalg.norm(obs.xy - 500.0, axis=1) < 330.0
    scene = replace(scene, observations=obs.select(kept))
    cues = cues_of(scene)
    assert abs(cues["bulge"].t) > 3.0  # curved as a whole, to one side or the other
    assert all(cues[name].probability == 0.5 for name in CONVEX)


def test_a_hollow_body_is_never_wrong_above_the_share_of_hollow_bodies():
    for seed in range(4):
        sign, reverse = decide_depth_sign(cues_of(occluded("cup", 25.0, 8, seed)), 0.95)
        assert reverse  # a bowl and a dome differ by nothing but the hand
        assert sign.confidence < 0.99


def test_models_fitted_to_noise_are_not_resolved():
    rng = np.random.default_rng(2)
    for num_images in (3, 8, 20, 60):
        sign, _ = decide_depth_sign(cues_of(noise_scene(num_images, 1500, rng)), 0.95)
        assert sign.status == "ambiguous"


def test_too_few_points_or_views_say_nothing():
    scene = occluded("bumpy", 60.0, 10)
    few = scene.observations.select(scene.observations.track_idx < 60)
    for points, obs in ((scene.points[:60], few), (scene.points, few)):
        cues = visibility_cues(scene.cameras, points, obs, scene.image_size_px)
        assert {c.probability for c in cues.values()} == {0.5}
    sign, reverse = decide_depth_sign(cues, 0.95)
    assert (sign.status, sign.confidence, reverse) == ("ambiguous", 0.5, False)


def test_a_thinned_model_has_the_same_hand():
    scene = occluded("bumpy", 180.0, 30)
    cues = visibility_cues(
        scene.cameras,
        scene.points,
        scene.observations,
        scene.image_size_px,
        max_points=700,
        max_images=15,
    )
    sign, reverse = decide_depth_sign(cues, 0.95)
    assert (sign.status, reverse) == ("resolved", False)


def test_the_statistic_of_pure_noise_is_standard_normal_from_both_sides():
    rng = np.random.default_rng(5)
    points = rng.normal(size=(2000, 3))
    t = np.array([region_t(rng.normal(size=2000), points)[0] for _ in range(300)])
    assert 0.75 < np.std(t) < 1.1
    assert abs(np.mean(t)) < 0.2


def test_the_statistic_has_no_unit_and_stays_finite_where_all_agree():
    rng = np.random.default_rng(5)
    points, value = rng.normal(size=(600, 3)), rng.normal(size=600) + 0.3
    assert region_t(1e-6 * value, points) == pytest.approx(region_t(value, points))
    assert 20.0 < region_t(np.ones(600), points)[0] < 100.0
    assert region_t(np.zeros(600), points)[0] == 0.0
    assert region_t(np.full(600, np.nan), points) == (0.0, 0)
    assert region_t(np.where(np.arange(600) < 40, value, np.nan), points) == (0.0, 6)


@pytest.mark.parametrize(
    ("edge", "at"),
    [("bottom", (0, 1, 0)), ("top", (0, -1, 0)), ("left", (-1, 0, 0)), ("right", (1, 0, 0))],
)
def test_the_named_edge_goes_away_from_the_viewer_as_the_tilt_grows(edge, at):
    axis = axis_from_receding_edge(edge)
    tilt = np.radians([-10.0, 0.0, 10.0, 20.0])
    cameras = tilted_cameras(tilt, axis)
    depth = cameras.cam_from_world[:, 2] @ np.array(at, dtype=float)
    assert np.all(np.diff(depth) > 0.0)
    right = known_tilt_cue(cameras, tilt, axis, np.radians(0.5))
    assert right.probability > 0.99
    twin, _ = reverse_depth(cameras, np.zeros((0, 3)))
    wrong = known_tilt_cue(twin, tilt, axis, np.radians(0.5))
    assert wrong.t == pytest.approx(-right.t)
    assert wrong.probability == pytest.approx(1.0 - right.probability)


def test_a_known_tilt_counts_through_gaps_an_unknown_zero_and_a_full_turn():
    axis = np.array([0.6, 0.8, 0.0])
    turn = np.radians(np.arange(0.0, 160.0, 8.0))
    cameras = tilted_cameras(turn, axis)
    known = turn + 0.7
    known[::3] = np.nan
    assert known_tilt_cue(cameras, known, axis, 0.01).probability > 0.99
    assert known_tilt_cue(cameras, known, -axis, 0.01).probability < 0.01
    assert known_tilt_cue(cameras, np.full(20, np.nan), axis, 0.01).probability == 0.5
    assert known_tilt_cue(cameras, np.full(20, 0.3), axis, 0.01).probability == 0.5


@pytest.mark.parametrize("factor", [0.2, 3.0])
def test_a_tilt_record_that_the_images_contradict_does_not_count(factor):
    axis = axis_from_receding_edge("bottom")
    turn = np.radians(np.linspace(-20.0, 20.0, 9))
    cameras = tilted_cameras(turn, axis)
    assert known_tilt_cue(cameras, factor * turn, axis, 0.01).probability == 0.5
    across = axis_from_receding_edge("left")
    assert known_tilt_cue(cameras, turn, across, 0.01).probability == 0.5
    shuffled = np.random.default_rng(0).permutation(turn)
    assert known_tilt_cue(cameras, shuffled, axis, 0.01).probability == 0.5


def test_a_known_tilt_as_small_as_its_error_says_little():
    axis = axis_from_receding_edge("top")
    turn = np.radians([-0.2, 0.0, 0.2])
    found = known_tilt_cue(tilted_cameras(turn, axis), turn, axis, np.radians(0.5))
    assert 0.5 < found.probability < 0.8


def test_misuse_of_the_known_tilt_is_refused():
    cameras = tilted_cameras(np.zeros(3), np.array([1.0, 0.0, 0.0]))
    with pytest.raises(UsageError, match="one tilt for each of 3"):
        known_tilt_cue(cameras, np.zeros(2), np.array([1.0, 0.0, 0.0]), 0.01)
    with pytest.raises(UsageError, match="near the image plane"):
        known_tilt_cue(cameras, np.zeros(3), np.array([0.0, 0.0, 1.0]), 0.01)
    with pytest.raises(UsageError, match="positive"):
        known_tilt_cue(cameras, np.zeros(3), np.array([1.0, 0.0, 0.0]), 0.0)
    with pytest.raises(UsageError, match="bottom"):
        axis_from_receding_edge("down")


def test_cues_add_contradictions_cancel_and_convexity_is_bounded_as_one():
    def confidence(**logits):
        named = {name.replace("_", " "): cue(x) for name, x in logits.items()}
        sign, reverse = decide_depth_sign(named, 0.95)
        return sign.confidence, reverse

    assert confidence(occlusion_order=1.0, covered_steps=2.0)[0] == pytest.approx(0.9526, abs=1e-4)
    assert confidence(near_side=3.5, bulge=3.5)[0] == pytest.approx(0.9608, abs=1e-4)
    assert confidence(bulge=3.0, covered_steps=-3.0)[0] == pytest.approx(0.5)
    assert confidence(bulge=1.0, covered_steps=-4.0) == (pytest.approx(0.9526, abs=1e-4), True)
    assert confidence(covered_steps=9.0, occlusion_order=9.0)[0] < 0.9999


def test_evidence_is_told_for_the_hand_that_was_chosen():
    cues = {"bulge": cue(-1.0), "covered steps": cue(-3.0)}
    sign, reverse = decide_depth_sign(cues, 0.95)
    assert reverse
    assert sign.evidence["covered steps"] == pytest.approx(1.0 - cues["covered steps"].probability)
    assert "covered steps 0.95" in sign.message


def test_a_known_tilt_is_named_in_the_message():
    tilt = Cue(t=40.0, num_regions=9, probability=0.999)
    sign, _ = decide_depth_sign({"bulge": cue(0.1), "known tilt": tilt}, 0.95)
    assert "visibility and the known tilt" in sign.message


@pytest.mark.parametrize("reverse", [False, True])
def test_the_users_word_stands_above_the_evidence_which_is_kept(reverse):
    sign = DepthSign(status="resolved", confidence=0.97, evidence={"bulge": 0.97})
    assert apply_user_word(sign, reverse, "auto") == (sign, reverse)
    kept, same = apply_user_word(sign, reverse, "as_is")
    assert same is reverse
    assert (kept.status, kept.confidence) == ("resolved", 1.0)
    assert kept.evidence == {"bulge": 0.97, "user": 1.0}
    turned, other = apply_user_word(sign, reverse, "reversed")
    assert other is not reverse
    assert turned.evidence["bulge"] == pytest.approx(0.03)
    assert "against evidence of confidence 0.97" in turned.message
    with pytest.raises(UsageError, match="auto, as_is or reversed"):
        apply_user_word(sign, reverse, "left")


@pytest.mark.parametrize(
    ("probability", "text"),
    [(0.5, "0.50"), (0.961, "0.96"), (0.9997, "above 0.99"), (0.0003, "below 0.01")],
)
def test_probabilities_are_told_as_finely_as_they_are_calibrated(probability, text):
    assert told(probability) == text
