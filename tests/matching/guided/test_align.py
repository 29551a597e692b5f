"""Sub-pixel alignment of patches against known shifts, warps, brightness and noise."""

import numpy as np
import pytest

from semsfm_colmap.matching.guided.align import align_patches, prepare_templates, read_patches
from semsfm_colmap.matching.guided.filtering import band_pass
from semsfm_colmap.matching.guided.patch_kernels import read_patch
from tests.oracles.alignment import align_by_least_squares, catmull_rom

RADIUS, SIGMA = 5, 2.5
SIZE = 200
CENTRES = np.stack(np.meshgrid(*[np.arange(30.5, 170.0, 12.0)] * 2), axis=-1).reshape(-1, 2)


def texture(x, y, seed=0):
    """A smooth random function with known values everywhere, wavelengths of 7 to 16 px."""
    rng = np.random.default_rng(seed)
    total = np.zeros(np.broadcast(x, y).shape)
    for _ in range(60):
        k = 2 * np.pi / rng.uniform(7.0, 16.0)
        angle, phase = rng.uniform(0, 2 * np.pi, size=2)
        total += np.cos(k * (np.cos(angle) * x + np.sin(angle) * y) + phase)
    return 10.0 * total


def grid():
    """Positions of pixel centres in COLMAP's coordinates."""
    return np.meshgrid(np.arange(SIZE) + 0.5, np.arange(SIZE) + 0.5)


def image(transform=lambda x, y: (x, y)):
    return texture(*transform(*grid())).astype(np.float32)


def find(reference, other, xy=CENTRES, warp=None, **options):
    templates = prepare_templates(read_patches(reference, CENTRES, RADIUS), SIGMA)
    return align_patches(
        templates,
        np.arange(len(CENTRES)),
        other,
        xy,
        np.broadcast_to(np.eye(2) if warp is None else warp, (len(CENTRES), 2, 2)),
        **{"max_shift_px": 2.0, "min_correlation": 0.75, **options},
    )


@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.3, -0.7), (1.1, 0.6)])
def test_a_shift_is_found_to_a_hundredth_of_a_pixel(shift):
    moved = image(lambda x, y: (x - shift[0], y - shift[1]))
    alignment = find(image(), moved)
    assert alignment.found.mean() > 0.95
    error = alignment.xy[alignment.found] - CENTRES[alignment.found] - shift
    assert np.abs(error).max() < 0.02
    assert np.abs(np.median(error, axis=0)).max() < 0.01  # of the cubic interpolation


def test_gain_offset_and_ramp_do_not_matter():
    x, _ = grid()
    moved = 0.6 * image(lambda x, y: (x - 0.4, y)) + 30.0 + 0.8 * x
    alignment = find(image(), moved.astype(np.float32))
    assert alignment.found.mean() > 0.95
    error = alignment.xy[alignment.found] - CENTRES[alignment.found] - [0.4, 0.0]
    assert np.abs(error).max() < 0.02


def test_a_predicted_squeeze_is_followed():
    W = np.array([[0.7, 0.1], [0.0, 1.0]])
    inverse = np.linalg.inv(W)

    def unsqueeze(x, y):
        return (inverse[0, 0] * x + inverse[0, 1] * y, inverse[1, 0] * x + inverse[1, 1] * y)

    alignment = find(image(), image(unsqueeze), xy=CENTRES @ W.T + [0.5, -0.3], warp=W)
    assert alignment.found.mean() > 0.9
    error = alignment.xy[alignment.found] - (CENTRES @ W.T)[alignment.found]
    assert np.abs(error).max() < 0.03


def test_another_texture_an_inverted_and_a_flat_one_are_not_found():
    assert find(image(), texture(*grid(), seed=9).astype(np.float32)).found.mean() < 0.02
    assert not find(image(), -image()).found.any()
    assert not find(image(), np.full((SIZE, SIZE), 7.0, np.float32)).found.any()


def test_flat_patches_edges_and_places_outside_are_left_out():
    x, _ = grid()
    edge = np.tanh(x - 100.0).astype(np.float32)
    assert not find(edge, edge).found.any()
    outside = find(image(), image(), xy=CENTRES - 1000.0)
    assert not outside.found.any()
    not_a_number = find(image(), image(), xy=np.full_like(CENTRES, np.nan))
    assert not not_a_number.found.any()


def test_a_patch_further_than_the_limit_is_not_found():
    moved = image(lambda x, y: (x - 1.2, y))
    assert find(image(), moved, max_shift_px=2.0).found.mean() > 0.9
    assert not find(image(), moved, max_shift_px=1.0).found.any()


def test_the_minimum_is_that_of_plain_least_squares():
    """The oracle minimises the formula of the module over all six unknowns."""
    rng = np.random.default_rng(3)
    reference = image() + rng.normal(size=(SIZE, SIZE)).astype(np.float32) * 0.5
    other = image(lambda x, y: (x - 0.5, y + 0.2)).astype(np.float32)
    other = (1.2 * other + rng.normal(size=(SIZE, SIZE)) * 0.5).astype(np.float32)
    alignment = find(reference, other)
    for k in np.flatnonzero(alignment.found)[::12]:
        plain = align_by_least_squares(reference, other, CENTRES[k], CENTRES[k], RADIUS, SIGMA)
        # the step uses the gradient of one patch, the oracle that of the other: noise differs
        assert np.linalg.norm(alignment.xy[k] - plain) < 0.025


def test_the_covariance_is_that_of_repeated_noise():
    rng = np.random.default_rng(4)
    reference, clean = image(), image(lambda x, y: (x - 0.3, y - 0.1))
    errors, variances = [], []
    for _ in range(30):
        noisy = (clean + rng.normal(size=clean.shape) * 6.0).astype(np.float32)
        alignment = find(reference, noisy)
        errors.append(alignment.xy - CENTRES - [0.3, 0.1])
        variances.append(np.trace(alignment.covariance, axis1=1, axis2=2))
    ratio = np.nanmean(np.sum(np.square(errors), axis=2)) / np.nanmean(variances)
    assert 0.75 < ratio < 1.35


def test_band_pass_takes_out_constants_and_ramps_and_keeps_fine_texture():
    x, y = grid()
    ramp = (3.0 + 0.2 * x - 0.1 * y).astype(np.float32)
    inner = (slice(20, -20), slice(20, -20))
    assert np.abs(band_pass(ramp, 2.0)[inner]).max() < 1e-3
    fine = image()
    assert band_pass(fine, 2.0)[inner].std() > 0.4 * fine[inner].std()


@pytest.mark.parametrize("x", [12.0, 31.4999, 5970.27])
def test_a_patch_is_read_by_cubic_interpolation_anywhere_in_a_large_image(x):
    rng = np.random.default_rng(5)
    pixels = rng.normal(size=(60, 6000)).astype(np.float32)
    W, y, radius = np.array([[1.1, -0.4], [0.3, 0.8]]), 30.75, 6
    patch = np.full((2 * radius + 1, 2 * radius + 1), 7.0, np.float32)
    assert read_patch(pixels, x, y, W, radius, 1, patch)
    assert (patch[[0, -1]] == 7.0).all()
    assert (patch[:, [0, -1]] == 7.0).all()
    for j in range(1, 2 * radius):
        for i in range(1, 2 * radius):
            place = W @ [i - radius, j - radius] + [x, y]
            # single precision: places to 2e-6 px, slopes of a few units a pixel
            assert patch[j, i] == pytest.approx(catmull_rom(pixels, *place), abs=3e-5)


def test_a_patch_that_leaves_the_image_is_not_read():
    pixels, patch = np.zeros((60, 80), np.float32), np.zeros((13, 13), np.float32)
    # a cubic needs a pixel before and two after
    for x, inside in ((6.99, False), (7.0, True), (71.99, True), (72.0, False)):
        assert read_patch(pixels, x, 30.0, np.eye(2), 6, 0, patch) == inside
    assert not read_patch(pixels, np.nan, 30.0, np.eye(2), 6, 0, patch)
