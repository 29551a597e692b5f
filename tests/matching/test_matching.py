import numpy as np
import pytest

from semsfm_colmap.matching.filters import distance_filter, static_matches
from semsfm_colmap.matching.options import MatchingOptions
from semsfm_colmap.matching.pairs import select_pairs
from semsfm_colmap.matching.ransac import (
    find_affine_fundamental,
    hyperplanes_from_samples,
    log_false_alarms,
)
from semsfm_colmap.matching.statistics import pair_statistics
from semsfm_colmap.matching.verify import verify_pair
from semsfm_colmap.records import MATCH_STEPS
from semsfm_colmap.synthetic.tracks import simulate_tracks


def matches(num: int, outlier_share: float, seed: int = 0, noise_px: float = 0.3):
    """Correspondences of two views of a rough field, a share of them random."""
    rng = np.random.default_rng(seed)
    s = simulate_tracks(
        num_images=2, range_deg=10, num_tracks=num, noise_px=noise_px, body="field", rng=rng
    )
    xy = s.observations.xy.reshape(-1, 2, 2)
    xy1, xy2 = xy[:, 0].copy(), xy[:, 1].copy()
    wrong = rng.random(num) < outlier_share
    xy2[wrong] = rng.uniform(100, 900, (wrong.sum(), 2))
    return xy1, xy2, wrong


def find(xy1, xy2, seed=0):
    return find_affine_fundamental(
        xy1,
        xy2,
        max_error_px=2.0,
        min_num_inliers=15,
        trials=500,
        rng=np.random.default_rng(seed),
    )


def test_few_images_are_matched_exhaustively_and_many_with_neighbours_across_the_seam():
    few = select_pairs(5, MatchingOptions())
    assert len(few) == 10
    many = select_pairs(40, MatchingOptions(overlap=3))
    assert (0, 1) in many
    assert (0, 39) in many
    assert (1, 38) in many
    assert (0, 10) not in many
    assert len(many) == 120
    opened = select_pairs(40, MatchingOptions(overlap=3, loop_closure=False))
    assert (0, 39) not in opened
    assert all(i < j for i, j in many)


def test_shuffled_images_are_matched_with_their_neighbours_in_predicted_angle():
    options = MatchingOptions(overlap=3)
    shuffled = np.random.default_rng(0).permutation(40)
    angle = np.radians(5.0) * shuffled
    pairs = select_pairs(40, options, angle)
    places = {tuple(sorted((shuffled[i], shuffled[j]))) for i, j in pairs}
    assert places == set(select_pairs(40, options))
    assert all(i < j for i, j in pairs)


def test_images_of_several_turns_are_matched_with_those_a_turn_on():
    angle = np.radians(10.0) * np.arange(80)
    pairs = set(select_pairs(80, MatchingOptions(overlap=3), angle))
    assert {(0, 35), (0, 36), (0, 37), (43, 79)} <= pairs
    assert (0, 18) not in pairs
    opened = set(select_pairs(80, MatchingOptions(overlap=3, loop_closure=False), angle))
    assert (0, 36) not in opened
    assert opened == set(select_pairs(80, MatchingOptions(overlap=3, loop_closure=False)))


def test_a_hyperplane_through_four_points_contains_them_and_has_unit_normal():
    points = np.random.default_rng(0).normal(size=(20, 4, 4))
    n, e = hyperplanes_from_samples(points)
    assert np.allclose(np.linalg.norm(n, axis=1), 1.0)
    assert np.allclose(np.einsum("tij,tj->ti", points, n) + e[:, None], 0.0, atol=1e-9)


@pytest.mark.parametrize("share", [0.0, 0.3, 0.6])
def test_true_matches_survive_and_most_wrong_ones_do_not(share):
    xy1, xy2, wrong = matches(600, share)
    F, inlier = find(xy1, xy2).value
    assert np.mean(inlier[~wrong]) > 0.99
    if wrong.any():
        assert np.mean(inlier[wrong]) < 0.1
    assert np.all(F[:2, :2] == 0)


def test_random_matches_are_not_taken_for_a_geometry():
    accepted = 0
    for seed in range(30):
        rng = np.random.default_rng(seed)
        xy1, xy2 = rng.uniform(0, 1000, (2, 150, 2))
        accepted += find(xy1, xy2, seed).value is not None
    assert accepted <= 1


def test_too_few_matches_are_said_to_be():
    xy1, xy2, _ = matches(10, 0.0)
    assert find(xy1, xy2).status == "too_few_matches"


def test_chance_explains_few_inliers_but_not_many():
    assert log_false_alarms(8, 100, 0.02) > np.log(1e-3)
    assert log_false_alarms(60, 100, 0.02) < -100


def test_distance_filter_drops_what_moves_much_further_than_the_rest():
    rng = np.random.default_rng(0)
    displacement = np.array([20.0, 0.0]) + rng.normal(size=(500, 2))
    displacement[:3] = [[300.0, 0.0], [20.0, -250.0], [-200.0, 0.0]]
    keep = distance_filter(displacement, 3.0)
    assert not keep[:3].any()
    assert keep[3:].mean() > 0.99
    assert distance_filter(displacement, 0.0).all()


def test_what_stands_still_is_rejected_only_where_it_piles_up():
    rng = np.random.default_rng(1)
    moving = np.array([12.0, 3.0]) + 3 * rng.normal(size=(300, 2))
    dust = 0.1 * rng.normal(size=(40, 2))
    static = static_matches(np.concatenate([moving, dust]), 0.5, 5.0)
    assert static[300:].all()
    assert not static[:300].any()
    # points near the axis of rotation pass through zero smoothly and stay
    smooth = rng.uniform(-10, 10, (600, 2))
    assert not static_matches(smooth, 0.5, 5.0).any()
    # where all moves by about a pixel along one line, half of it less than that, nothing is static
    slow = np.stack([rng.uniform(-1.2, 1.2, 700), 0.15 * rng.normal(size=700)], -1)
    assert not static_matches(slow, 0.5, 5.0).any()
    # a repeated view stands still as a whole and is kept
    assert not static_matches(dust, 0.5, 5.0).any()


def test_verification_counts_what_each_filter_took_and_does_not_depend_on_the_order_of_pairs():
    xy1, xy2, _ = matches(400, 0.2)
    rows = np.column_stack([np.arange(400), np.arange(400)])
    first = verify_pair((0, 1), xy1, xy2, rows, MatchingOptions(), 7)
    again = verify_pair((0, 1), xy1, xy2, rows, MatchingOptions(), 7)
    assert np.array_equal(first.inlier, again.inlier)
    assert first.inlier.sum() <= 400 - sum(first.rejected_by.values())
    assert np.all(np.abs(first.residual_px[first.inlier]) < 2.0)
    empty = verify_pair((0, 1), xy1, xy2, np.zeros((0, 2), dtype=np.int64), MatchingOptions(), 7)
    assert empty.F is None
    assert "0 matches" in (empty.failure or "")


def test_the_step_of_each_match_adds_up_to_the_counts_of_the_pair():
    xy1, xy2, wrong = matches(400, 0.3)
    xy1, xy2 = np.vstack([xy1, np.full((60, 2), 50.0)]), np.vstack([xy2, np.full((60, 2), 50.0)])
    rows = np.column_stack([np.arange(460)] * 2)
    found = verify_pair((0, 1), xy1, xy2, rows, MatchingOptions(), 0)
    assert found.step is not None
    counts = np.bincount(found.step, minlength=len(MATCH_STEPS))
    statistics = pair_statistics([found], ("a", "b"))[0]
    assert counts[0] == statistics.num_static_rejected == 60
    assert counts[2:].sum() == statistics.num_after_affine_ransac
    assert counts[3] == statistics.num_after_distance_filter == found.inlier.sum()
    assert set(found.step[400:]) == {0}
    assert np.mean(found.step[:400][wrong] == 1) > 0.9
    np.testing.assert_array_equal(found.inlier, found.step == len(MATCH_STEPS) - 1)


def test_matches_of_a_pair_without_geometry_were_dropped_by_ransac():
    rng = np.random.default_rng(0)
    xy1, xy2 = rng.uniform(0.0, 900.0, (2, 30, 2))
    rows = np.column_stack([np.arange(30)] * 2)
    found = verify_pair((0, 1), xy1, xy2, rows, MatchingOptions(), 0)
    assert found.failure is not None
    assert found.step is not None
    assert set(found.step) == {1}
