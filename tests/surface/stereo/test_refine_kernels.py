"""Gauss-Newton steps, against closed forms and derivatives."""

from __future__ import annotations

import numpy as np
import pytest

from semsfm_colmap.surface.stereo.refine_kernels import slanted_step, view_terms
from semsfm_colmap.types import Array, Float


def terms_at(shift: float, image: Array, window: Float, weight: Array, a: Array) -> Float:
    gradient = np.gradient(image.astype(float), axis=1)
    view = np.ascontiguousarray(np.stack([image, gradient], axis=-1).astype(np.float32))
    affine = np.array([1.02, 0.01, -0.02, 0.99, 20.0 + shift, 15.0], dtype=np.float32)
    terms = np.zeros(3, dtype=np.float32)
    buffers = np.zeros((2, len(window)), dtype=np.float32)
    view_terms(view, affine, window, weight, a, 0.0, buffers[0], buffers[1], terms)
    return terms.astype(float)


def stereo_pair(true_depth: float) -> dict[str, Array]:
    """A fronto-parallel surface at one depth, seen by the reference and two neighbours."""
    y, x = np.mgrid[0:40, 0:60].astype(float)

    def texture(u: Float, v: Float) -> Array:
        waves = np.sin(0.6 * u + 0.2 * v) + np.cos(0.5 * v - 0.4 * u) + np.sin(0.9 * u - 0.7 * v)
        return (25.0 * waves).astype(np.float32)

    c = np.array([[0.3, 0.0], [-0.3, 0.05]])
    grey = texture(x, y)
    views = []
    for k in range(2):
        view = texture(x - c[k, 0] * true_depth, y - c[k, 1] * true_depth)
        slope = c[k, 0] * np.gradient(view, axis=1) + c[k, 1] * np.gradient(view, axis=0)
        views.append(np.stack([view, slope], axis=-1))
    return {"grey": grey, "views": np.stack(views).astype(np.float32), "c": c}


def test_the_gauss_newton_terms_are_the_derivatives_of_the_correlation() -> None:
    # slow waves, so that interpolation and the image's gradient agree
    y, x = np.mgrid[0:31, 0:41].astype(float)
    image = (20 * np.sin(0.12 * x + 0.1 * y) + 15 * np.cos(0.1 * y - 0.08 * x)).astype(np.float32)
    window = np.array([(i, j) for j in range(-3, 4) for i in range(-3, 4)], dtype=np.float32)
    weight = np.exp(-0.1 * (window**2).sum(axis=1)).astype(np.float32)
    weight /= weight.sum()
    a = np.array([image[15 + int(j), 18 + int(i)] for i, j in window], dtype=np.float32)
    a -= weight @ a
    a /= np.sqrt(weight @ a**2)
    step = 0.05
    correlation, numerator, denominator = terms_at(0.0, image, window, weight, a)
    high = terms_at(step, image, window, weight, a)[0]
    low = terms_at(-step, image, window, weight, a)[0]
    # with |a| = |b| = 1, sum w (a - b)^2 = 2 - 2 corr: its half falls as the numerator says
    assert numerator == pytest.approx((high - low) / (2 * step), rel=0.05)
    assert denominator > 0.0
    assert correlation < 1.0


@pytest.mark.parametrize("start_error", [-1.5, 0.8])
def test_slanted_steps_lead_to_the_true_depth(start_error: float) -> None:
    pair = stereo_pair(5.0)
    depth = np.full((40, 60), 5.0 + start_error, dtype=np.float32)
    score = np.ones_like(depth)
    information = np.ones_like(depth)
    window = np.array([(i, j) for j in range(-3, 4) for i in range(-3, 4)])
    for _ in range(4):
        plane = np.stack([depth, np.zeros_like(depth), np.zeros_like(depth)])
        slanted_step(
            pair["grey"],
            np.stack([pair["grey"]] * 2),
            plane,
            pair["views"],
            np.ones((2, 40, 60), np.uint8),
            np.tile(np.eye(2), (2, 1, 1)),
            pair["c"],
            np.zeros((2, 2)),
            window,
            np.ones(len(window), np.float32),
            np.full(3, 0.3),
            500.0,
            0.4,
            0.0,
            1,
            depth,
            score,
            information,
        )
    inner = np.s_[8:-8, 8:-8]
    assert np.abs(depth[inner] - 5.0).max() < 0.06
    assert score[inner].min() > 0.98


def test_a_neighbour_that_sees_something_else_is_outvoted() -> None:
    pair = stereo_pair(5.0)
    views = np.concatenate([pair["views"], np.random.default_rng(0).normal(0, 30, (1, 40, 60, 2))])
    depth = np.full((40, 60), 5.4, dtype=np.float32)
    score = np.ones_like(depth)
    information = np.ones_like(depth)
    window = np.array([(i, j) for j in range(-2, 3) for i in range(-2, 3)])
    for _ in range(4):
        plane = np.stack([depth, np.zeros_like(depth), np.zeros_like(depth)])
        slanted_step(
            pair["grey"],
            np.stack([pair["grey"]] * len(views)),
            plane,
            views.astype(np.float32),
            np.ones((3, 40, 60), np.uint8),
            np.tile(np.eye(2), (3, 1, 1)),
            np.concatenate([pair["c"], [[0.2, 0.2]]]),
            np.zeros((3, 2)),
            window,
            np.ones(len(window), np.float32),
            np.full(4, 0.3),
            500.0,
            0.4,
            0.0,
            1,
            depth,
            score,
            information,
        )
    assert np.abs(depth[8:-8, 8:-8] - 5.0).max() < 0.06


def test_an_unknown_depth_stays_unknown() -> None:
    pair = stereo_pair(5.0)
    depth = np.full((40, 60), np.nan, dtype=np.float32)
    score = np.ones_like(depth)
    information = np.ones_like(depth)
    plane = np.full((3, 40, 60), np.nan, dtype=np.float32)
    one = np.zeros((1, 2), dtype=np.int64)
    eye = np.tile(np.eye(2), (2, 1, 1))
    slanted_step(
        pair["grey"], np.stack([pair["grey"]] * 2), plane, pair["views"],
        np.ones((2, 40, 60), np.uint8), eye, pair["c"],
        np.zeros((2, 2)), one, np.ones(1, np.float32), np.ones(3), 10.0, 0.4, 0.0, 1, depth, score,
        information,
    )  # fmt: skip
    assert np.isnan(depth).all()
    assert (score == 0).all()
    assert (information == 0).all()


def test_the_information_of_a_window_is_the_variance_that_noise_gives_its_depth() -> None:
    rng = np.random.default_rng(3)
    y, x = np.mgrid[-3:4, -3:4]
    window = np.stack([x.ravel(), y.ravel()], axis=1)
    found, stated = [], []
    for _ in range(30):
        pair = stereo_pair(5.0)
        noise_sigma = 4.0
        grey = pair["grey"] + rng.normal(0, noise_sigma, pair["grey"].shape).astype(np.float32)
        views = pair["views"].copy()
        for k in range(2):
            views[k, ..., 0] += rng.normal(0, noise_sigma, grey.shape)
        depth = np.full((40, 60), 5.0, dtype=np.float32)
        score, information = np.ones_like(depth), np.ones_like(depth)
        plane = np.stack([depth, np.zeros_like(depth), np.zeros_like(depth)])
        slanted_step(
            grey, np.stack([grey] * 2), plane, views, np.ones((2, 40, 60), np.uint8),
            np.tile(np.eye(2), (2, 1, 1)),
            pair["c"], np.zeros((2, 2)), window, np.ones(len(window), np.float32), np.full(3, 0.3),
            500.0, 0.4, 0.0, 1, depth, score, information,
        )  # fmt: skip
        found.append(depth[10:-10:10, 10:-10:10] - 5.0)
        stated.append(information[10:-10:10, 10:-10:10] ** -0.5)
    # half of the samples count as independent: all of them are here, hence up to sqrt(2) too wide
    assert 0.4 < np.std(found) / np.median(stated) < 1.2


def test_pixels_between_those_that_move_keep_their_planes_and_have_no_say() -> None:
    pair = stereo_pair(5.0)
    depth = np.full((40, 60), 4.2, dtype=np.float32)
    score = np.ones_like(depth)
    plane = np.stack([depth + 0.3, np.zeros_like(depth), np.zeros_like(depth)])
    window = np.array([(i, j) for j in range(-3, 4) for i in range(-3, 4)])
    slanted_step(
        pair["grey"], np.stack([pair["grey"]] * 2), plane, pair["views"],
        np.ones((2, 40, 60), np.uint8), np.tile(np.eye(2), (2, 1, 1)), pair["c"], np.zeros((2, 2)),
        window,
        np.ones(len(window), np.float32), np.full(3, 0.3), 500.0, 0.4, 0.0, 2, depth, score,
        np.zeros_like(depth),
    )  # fmt: skip
    y, x = np.mgrid[0:40, 0:60]
    between = (x + y) % 2 == 1
    np.testing.assert_array_equal(depth[between], np.float32(4.5))
    assert (score[between] == 0.0).all()
    inner = np.s_[8:-8, 8:-8]
    assert np.abs(depth[inner][~between[inner]] - 5.0).max() < 0.25
    assert score[inner][~between[inner]].min() > 0.9
