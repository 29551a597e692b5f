import numpy as np
import pytest

from semsfm_colmap.segmentation.patches import connected_patches
from semsfm_colmap.segmentation.roughness import surface_variation
from semsfm_colmap.segmentation.walker import SEED_RATE, walk
from tests.oracles import segmentation as oracle
from tests.segmentation import shapes


def some_points(num=150, seed=0):
    rng = np.random.default_rng(seed)
    points, normals = shapes.ball(num, rng)
    return rng, points, normals


@pytest.mark.parametrize("smoothness", [0.1, 20.0])
def test_probabilities_are_those_of_a_dense_solution(smoothness):
    rng, points, normals = some_points()
    prior, rate = rng.uniform(size=150), rng.uniform(0.5, 2.0, 150)
    x = walk(points, normals, prior, rate, smoothness=smoothness, num_neighbors=8)
    np.testing.assert_allclose(
        x, oracle.walk(points, normals, prior, rate, smoothness, 8), atol=1e-5
    )


def test_seeds_keep_their_labels_and_spread_them():
    _, points, normals = some_points(600)
    prior = np.where(points[:, 1] > 0.8, 1.0, np.where(points[:, 1] < -0.8, 0.0, 0.5))
    rate = np.where(np.abs(points[:, 1]) > 0.8, SEED_RATE, 1e-3)
    x = walk(points, normals, prior, rate, smoothness=20.0, num_neighbors=8)
    assert np.all(x[prior == 1.0] > 0.9)
    assert np.all(x[prior == 0.0] < 0.1)
    # halfway between them on a ball is the equator
    assert np.mean((x > 0.5) == (points[:, 1] > 0)) > 0.9


def test_the_two_sides_of_a_sheet_do_not_share_a_label():
    rng = np.random.default_rng(0)
    xy = rng.uniform(size=(800, 2))
    upper = np.arange(800) < 400
    points = np.column_stack([xy, np.where(upper, 0.002, 0.0)])
    normals = np.column_stack([np.zeros((800, 2)), np.where(upper, 1.0, -1.0)])
    prior = np.where(upper, 1.0, 0.0)
    x = walk(points, normals, prior, np.ones(800), smoothness=20.0, num_neighbors=8)
    assert x[upper].min() > 0.97
    assert x[~upper].max() < 0.03


def test_roughness_is_that_of_a_plain_loop():
    _, points, normals = some_points(200, seed=1)
    np.testing.assert_allclose(
        surface_variation(points, normals, 12),
        oracle.surface_variation(points, normals, 12),
        atol=1e-12,
    )


def test_a_plane_has_no_roughness_and_noise_has_that_of_its_variance():
    rng = np.random.default_rng(0)
    xy = rng.uniform(size=(4000, 2))
    normals = np.tile([0.0, 0.0, 1.0], (4000, 1))
    flat = np.column_stack([xy, np.zeros(4000)])
    assert surface_variation(flat, normals, 24).max() < 1e-12
    sigma = 0.002
    rough = flat + sigma * rng.normal(size=(4000, 1)) * normals
    # 24 neighbours of a disc with 24 / 4000 of the area: variance r^2 / 4 along either axis
    within = 24.0 / 4000.0 / np.pi / 4.0
    share = sigma**2 / (sigma**2 + 2.0 * within)
    median = np.median(surface_variation(rough, normals, 24))
    assert 0.7 * share < median < 1.1 * share


def test_patches_are_those_that_a_search_finds():
    rng = np.random.default_rng(0)
    centres = np.array([[0.0, 0, 0], [3, 0, 0], [0, 4, 0]])
    points = np.concatenate([c + 0.3 * rng.normal(size=(60, 3)) for c in centres])
    chosen = rng.uniform(size=180) < 0.8
    found = {frozenset(p.tolist()) for p in connected_patches(points, chosen, 6)}
    truth = oracle.patches(points, chosen, 1.0)
    assert found == truth
    assert len(found) == 3


@pytest.mark.parametrize("num", [0, 1, 5])
def test_few_chosen_points_are_one_patch_or_none(num):
    points = np.random.default_rng(0).normal(size=(20, 3))
    found = connected_patches(points, np.arange(20) < num, 8)
    assert [len(p) for p in found] == ([num] if num else [])
