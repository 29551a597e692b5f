import numpy as np
import pytest
from scipy import sparse
from scipy.linalg import LinAlgError

from semsfm_colmap.geometry import band, reduced
from semsfm_colmap.geometry.band import BandLayout, BandMatrix
from semsfm_colmap.geometry.reduced import band_layout, covisible_pairs, narrow_order, reach_of
from tests.banded import solve_in_bands

NUM_IMAGES = 40


def closed_turn(num_shared: int, seed: int = 0):
    """Blocks of a turn of images in any order, each meeting its three neighbours on either side."""
    rng = np.random.default_rng(seed)
    place = rng.permutation(NUM_IMAGES)
    # a track an image: it and the next three
    track = np.sort(place[(np.arange(NUM_IMAGES)[:, None] + np.arange(4)) % NUM_IMAGES], axis=1)
    pairs = covisible_pairs(track.ravel(), np.arange(0, track.size + 1, 4), NUM_IMAGES)
    param_idx = np.full((NUM_IMAGES, 5 + num_shared), -1)
    param_idx[:, :5] = np.arange(5 * NUM_IMAGES).reshape(NUM_IMAGES, 5)
    n = 5 * NUM_IMAGES
    param_idx[:, 5:] = n + np.arange(num_shared)
    param_idx[::7, 2] = -1
    used = np.unique(param_idx[param_idx >= 0])
    number = np.full(n + num_shared + 1, -1)
    number[used] = np.arange(len(used))
    param_idx = number[param_idx]
    p = param_idx.shape[1]
    blocks = 0.1 * rng.normal(size=(len(pairs.first), p, p))
    own = pairs.first == pairs.second
    blocks[own] = blocks[own] + blocks[own].mT + 8.0 * np.eye(p)
    return pairs, param_idx, len(used), blocks


def dense_sum(pairs, param_idx, n, blocks):
    A = np.zeros((n + 1, n + 1))
    for a, b, block in zip(pairs.first, pairs.second, blocks, strict=True):
        np.add.at(A, np.ix_(param_idx[a], param_idx[b]), block)
        if a != b:
            np.add.at(A, np.ix_(param_idx[b], param_idx[a]), block.T)
    # index -1 writes the last row
    return A[:n, :n]


def matrix_of(monkeypatch, num_shared, banded=True, size=256):
    monkeypatch.setattr(band, "BLOCK", size)
    if banded:
        solve_in_bands(monkeypatch)
    pairs, param_idx, n, blocks = closed_turn(num_shared)
    nothing = sparse.csr_array((0, n))
    matrix = BandMatrix.zeros(band_layout(pairs, param_idx, n, nothing))
    matrix.add_blocks(blocks, pairs.first, pairs.second, param_idx)
    assert (matrix.layout.num_blocks > 4) == banded
    return matrix, dense_sum(pairs, param_idx, n, blocks), pairs, param_idx


@pytest.fixture(
    params=[(0, True), (0, True, 12), (2, True), (2, True, 9), (2, False)],
    ids=["turn", "narrow blocks", "border", "border, narrow blocks", "dense"],
)
def system(request, monkeypatch):
    return matrix_of(monkeypatch, *request.param)


def test_a_band_holds_the_sum_of_the_blocks(system):
    matrix, A, _, _ = system
    assert np.allclose(matrix.toarray(), A, atol=1e-13)
    assert np.allclose(matrix.main_diagonal(), np.diag(A), atol=1e-13)


def test_a_system_solved_in_its_band_is_that_of_the_dense_one(system):
    matrix, A, _, _ = system
    rng = np.random.default_rng(1)
    damping = rng.uniform(0.0, 2.0, len(A))
    B = rng.normal(size=(len(A), 3))
    factor = matrix.factorise(damping)
    x = np.linalg.solve(A + np.diag(damping), B)
    assert np.allclose(factor.solve(B), x, atol=1e-12)
    assert np.allclose(factor.solve(B[:, 0]), x[:, 0], atol=1e-12)
    # the matrix is as it was
    assert np.allclose(matrix.factorise().solve(B), np.linalg.solve(A, B), atol=1e-12)


def test_the_inverse_within_the_band_is_that_of_the_dense_one(system):
    matrix, A, pairs, param_idx = system
    blocks = matrix.factorise().inverse().get_blocks(pairs.first, pairs.second, param_idx)
    Z = np.pad(np.linalg.inv(A), (0, 1))
    expected = Z[param_idx[pairs.first][:, :, None], param_idx[pairs.second][:, None, :]]
    assert np.allclose(blocks, expected, atol=1e-12)


def test_products_of_a_sparse_jacobian_are_added(system):
    matrix, A, _, param_idx = system
    J = np.zeros((3, len(A)))
    J[0, param_idx[4, 0]] = 2.0
    J[1, param_idx[5, :2]] = 1.0, -3.0
    J[2, param_idx[6, [0, -1]]] = 0.5, 4.0
    matrix.add_products(sparse.csr_array(J))
    assert np.allclose(matrix.toarray(), A + J.T @ J, atol=1e-12)


def test_a_matrix_that_is_not_positive_definite_is_refused(system):
    matrix, A, _, _ = system
    with pytest.raises(LinAlgError):
        matrix.factorise(-2.0 * np.diag(A))
    singular = BandMatrix.zeros(BandLayout.dense(3))
    singular.add_products(sparse.csr_array(np.diag([1.0, 0.0, 2.0])))
    with pytest.raises(LinAlgError):
        singular.factorise()


def test_a_border_that_is_not_positive_definite_is_refused(monkeypatch):
    matrix, A, _, _ = matrix_of(monkeypatch, 2)
    damping = np.zeros(len(A))
    damping[-1] = -1e4
    with pytest.raises(LinAlgError):
        matrix.factorise(damping)


def test_a_prior_between_images_without_a_common_track_widens_the_band(monkeypatch):
    solve_in_bands(monkeypatch)
    pairs, param_idx, n, blocks = closed_turn(0)
    far = np.argwhere(pairs.lookup < 0)[0]
    J = np.zeros((1, n))
    J[0, param_idx[far, 0]] = 1.0, -2.0
    matrix = BandMatrix.zeros(band_layout(pairs, param_idx, n, sparse.csr_array(J)))
    matrix.add_blocks(blocks, pairs.first, pairs.second, param_idx)
    matrix.add_products(sparse.csr_array(J))
    A = dense_sum(pairs, param_idx, n, blocks) + J.T @ J
    b = np.random.default_rng(2).normal(size=n)
    assert np.allclose(matrix.factorise().solve(b), np.linalg.solve(A, b), atol=1e-12)


def test_a_long_series_has_a_narrow_band_and_a_full_one_has_none():
    pairs, param_idx, n, _ = closed_turn(0)
    nothing = sparse.csr_array((0, n))
    assert band_layout(pairs, param_idx, n, nothing).num_blocks == 1  # small
    big = np.arange(6 * 200).reshape(200, 6)
    track = (np.arange(200)[:, None] + np.arange(3)) % 200
    pairs = covisible_pairs(np.sort(track, axis=1).ravel(), np.arange(0, 601, 3), 200)
    layout = band_layout(pairs, big, 1200, sparse.csr_array((0, 1200)))
    assert layout.size == reduced.MIN_BLOCK
    every = covisible_pairs(np.arange(200), np.array([0, 200]), 200)
    assert band_layout(every, big, 1200, sparse.csr_array((0, 1200))).num_blocks == 1


@pytest.mark.parametrize("closed", [False, True])
def test_a_series_in_any_order_gets_the_narrowest_band(closed):
    """A line has that of its neighbourhood; a closed turn is a line of pairs, twice as wide."""
    n, neighbours = 300, 12
    place = np.random.default_rng(0).permutation(n)
    i = np.repeat(np.arange(n), neighbours)
    j = i + np.tile(np.arange(1, neighbours + 1), n)
    inside = closed | (j < n)
    i, j = place[i[inside]], place[j[inside] % n]
    ones = np.ones(2 * len(i))
    graph = sparse.coo_array((ones, (np.append(i, j), np.append(j, i))), shape=(n, n))
    order = narrow_order(graph)
    assert np.array_equal(np.sort(order), np.arange(n))
    reach = reach_of(order, graph)
    if closed:
        assert 2 * neighbours <= reach <= 2 * neighbours + 2
    else:
        assert reach == neighbours
