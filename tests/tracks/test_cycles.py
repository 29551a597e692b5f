"""Three-view cycle consistency on small hand-made matches."""

import numpy as np

from semsfm_colmap.tracks.cycles import consistent_matches


def rows(*pairs):
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


def test_closed_cycles_are_kept():
    matches = {(0, 1): rows((0, 0)), (1, 2): rows((0, 0)), (0, 2): rows((0, 0))}
    assert all(keep.all() for keep in consistent_matches([1, 1, 1], matches).values())


def test_a_match_without_a_third_image_is_kept():
    keep = consistent_matches([3, 3], {(0, 1): rows((0, 2), (1, 1))})
    assert keep[0, 1].all()


def test_a_match_that_most_cycles_contradict_goes_and_those_that_close_stay():
    """Keypoint 0 is the same spot in all four images, but 0 - 1 is matched to its neighbour."""
    matches = {
        (0, 1): rows((0, 1), (2, 2)),
        (0, 2): rows((0, 0), (2, 2)),
        (0, 3): rows((0, 0), (2, 2)),
        (1, 2): rows((0, 0), (1, 1), (2, 2)),
        (1, 3): rows((0, 0), (1, 1), (2, 2)),
        (2, 3): rows((0, 0), (1, 1), (2, 2)),
    }
    keep = consistent_matches([3, 3, 3, 3], matches)
    assert keep[0, 1].tolist() == [False, True]
    # 0 - 2 and 0 - 3 close one cycle and break one, with the wrong match
    assert keep[0, 2].all()
    assert keep[0, 3].all()
    assert keep[2, 3].all()


def test_random_true_matches_survive_and_shifted_ones_fall():
    rng = np.random.default_rng(0)
    num_images, num_points = 6, 300
    matches, wrong = {}, {}
    for i in range(num_images):
        for j in range(i + 1, num_images):
            seen = rng.permutation(num_points)[:250]
            to = seen.copy()
            bad = rng.random(len(seen)) < 0.1
            to[bad] = np.roll(seen[bad], 1)
            matches[i, j] = np.column_stack([seen, to])
            wrong[i, j] = seen != to
    keep = consistent_matches([num_points] * num_images, matches)
    kept_wrong = np.mean(np.concatenate([keep[p][wrong[p]] for p in matches]))
    lost_right = np.mean(np.concatenate([~keep[p][~wrong[p]] for p in matches]))
    assert kept_wrong < 0.1
    assert lost_right < 0.1


def test_no_matches_at_all():
    assert consistent_matches([0, 0], {(0, 1): rows()})[0, 1].shape == (0,)


def seen_between(*also):
    """Five images, neighbours share ten points; keypoint 99 of the first and last are matched, and
    shown by the images `also` between them.
    """
    common = np.column_stack([np.arange(10), np.arange(10)])
    matches = {}
    for i in range(5):
        for j in range(i + 1, 5):
            extra = [99] if {i, j} <= {0, 4, *also} else []
            some = common if j - i < 4 else common[:3]
            matches[i, j] = np.concatenate([some, rows(*[(k, k) for k in extra]).reshape(-1, 2)])
    return matches


def test_a_match_of_far_images_that_none_between_shows_is_dropped():
    keep = consistent_matches([100] * 5, seen_between())
    assert keep[0, 4].tolist() == [True, True, True, False]
    assert all(good.all() for pair, good in keep.items() if pair != (0, 4))


def test_one_image_between_that_shows_the_point_is_enough():
    assert all(good.all() for good in consistent_matches([100] * 5, seen_between(2)).values())


def test_too_few_images_between_say_nothing():
    matches = {p: m for p, m in seen_between().items() if not {2, 3} & set(p)}
    assert all(good.all() for good in consistent_matches([100] * 5, matches).values())
