"""Gauss-Newton steps, against a plain one, closed forms and derivatives."""

from __future__ import annotations

import numpy as np
import pytest

from semsfm_colmap.surface.stereo.plane_kernels import local_planes
from semsfm_colmap.surface.stereo.refine_kernels import surface_step, view_terms
from semsfm_colmap.types import Array, Float
from tests.oracles import surface as oracle

WINDOW = np.array([(i, j) for j in range(-3, 4) for i in range(-3, 4)])


def stereo_pair(true_depth: float) -> dict[str, Array]:
    """A fronto-parallel surface at one depth, seen by the reference and two neighbours."""
    y, x = np.mgrid[0:40, 0:60].astype(float)

    def texture(u: Float, v: Float) -> Array:
        waves = np.sin(0.6 * u + 0.2 * v) + np.cos(0.5 * v - 0.4 * u) + np.sin(0.9 * u - 0.7 * v)
        return (25.0 * waves).astype(np.float32)

    c = np.array([[0.3, 0.0], [-0.3, 0.05]])
    views = [texture(x - k[0] * true_depth, y - k[1] * true_depth) for k in c]
    return {"grey": texture(x, y), "views": np.stack(views).astype(np.float32), "c": c}


def slopes_of(views: Array, c: Float) -> Array:
    """Change of each view's grey with depth."""
    slopes = [
        k[0] * np.gradient(v, axis=1) + k[1] * np.gradient(v, axis=0)
        for k, v in zip(c, views, strict=True)
    ]
    return np.stack(slopes).astype(np.float32)


def stepped(
    grey: Array,
    views: Array,
    c: Float,
    surface: Array,
    *,
    window: Array = WINDOW,
    noise: float = 0.3,
    grey_cut: float = 500.0,
    lit: Array | None = None,
) -> tuple[Array, Array, Array]:
    """Depth, score and information after one step from a surface, with unit windows."""
    num, shape = len(views), grey.shape
    depth, score, information = (np.ones(shape, dtype=np.float32) for _ in range(3))
    surface_step(
        grey, np.stack([grey] * num) if lit is None else lit, surface, views, slopes_of(views, c),
        np.ones(views.shape, np.uint8), np.tile(np.eye(2), (num, 1, 1)), c, np.zeros((num, 2)),
        window, np.ones(len(window), np.float32), np.full(1 + num, noise), grey_cut, 0.4, 0.0,
        depth, score, information,
    )  # fmt: skip
    return depth, score, information


def planes_of(depth: Array) -> Array:
    """What the next step starts from: without it, roughness finer than the window would stay."""
    return np.asarray(local_planes(depth, np.ones_like(depth), 3, 1.0)[0])


def test_a_step_is_that_of_the_plain_one() -> None:
    rng = np.random.default_rng(8)
    pair = stereo_pair(5.0)
    y, x = np.mgrid[0:40, 0:60]
    surface = (5.0 + 0.05 * x - 0.03 * y + rng.normal(0, 0.1, (40, 60))).astype(np.float32)
    surface[12:16, 20:24] = np.nan
    lit = np.stack([pair["grey"] * 1.1, pair["grey"] + 0.5 * x]).astype(np.float32)
    found = stepped(pair["grey"], pair["views"], pair["c"], surface, grey_cut=40.0, lit=lit)
    for row, column in [(8, 30), (14, 18), (20, 25), (30, 40)]:
        expected = oracle.surface_step(
            pair["grey"], lit, surface, pair["views"], slopes_of(pair["views"], pair["c"]),
            pair["c"], WINDOW, 0.3, 40.0, 0.4, row, column,
        )  # fmt: skip
        np.testing.assert_allclose([f[row, column] for f in found], expected, rtol=2e-3)


def test_the_gauss_newton_terms_are_the_derivatives_of_the_correlation() -> None:
    # slow waves, so that the image's gradient is that of its samples
    image = np.polynomial.Polynomial([3.0, 2.0, -0.4, 0.02, 0.003])
    places = np.linspace(-3.0, 3.0, 15)
    a = np.sin(places) + 0.3 * places

    def terms_at(shift: float) -> Float:
        b, g = image(places + shift), image.deriv()(places + shift)
        products = [a, b, g, a * a, b * b, g * g, a * b, a * g, b * g]
        sums = np.array([[p.mean()] for p in products], dtype=np.float32)
        terms = np.zeros((3, 1), dtype=np.float32)
        view_terms(sums, np.ones(1, dtype=np.float32), 0.0, 0.0, terms)
        return terms[:, 0].astype(float)

    step = 0.05
    correlation, numerator, denominator = terms_at(0.1)
    # with |a| = |b| = 1, sum w (a - b)^2 = 2 - 2 corr: its half falls as the numerator says
    slope = (terms_at(0.1 + step)[0] - terms_at(0.1 - step)[0]) / (2 * step)
    assert numerator == pytest.approx(slope, rel=0.02)
    assert denominator > 0.0
    assert correlation < 1.0


@pytest.mark.parametrize("start_error", [-1.5, 0.8])
def test_steps_lead_to_the_true_depth(start_error: float) -> None:
    pair = stereo_pair(5.0)
    surface = np.full((40, 60), 5.0 + start_error, dtype=np.float32)
    for _ in range(4):
        depth, score, _ = stepped(pair["grey"], pair["views"], pair["c"], surface)
        surface = planes_of(depth)
    inner = np.s_[8:-8, 8:-8]
    assert np.abs(depth[inner] - 5.0).max() < 0.06
    assert score[inner].min() > 0.98


def test_a_neighbour_that_sees_something_else_is_outvoted() -> None:
    pair = stereo_pair(5.0)
    other = np.random.default_rng(0).normal(0, 30, (1, 40, 60)).astype(np.float32)
    views = np.concatenate([pair["views"], other])
    c = np.concatenate([pair["c"], [[0.2, 0.2]]])
    surface = np.full((40, 60), 5.4, dtype=np.float32)
    for _ in range(4):
        depth, _, _ = stepped(pair["grey"], views, c, surface)
        surface = planes_of(depth)
    assert np.abs(depth[8:-8, 8:-8] - 5.0).max() < 0.06


def test_an_unknown_depth_stays_unknown_and_has_no_say() -> None:
    pair = stereo_pair(5.0)
    surface = np.full((40, 60), 5.2, dtype=np.float32)
    surface[:, 30:] = np.nan
    depth, score, information = stepped(pair["grey"], pair["views"], pair["c"], surface)
    assert np.isnan(depth[:, 30:]).all()
    assert (score[:, 30:] == 0).all()
    assert (information[:, 30:] == 0).all()
    assert np.abs(depth[8:-8, 8:30] - 5.0).max() < 0.1


def test_windows_that_do_not_fit_into_the_image_give_no_depth() -> None:
    pair = stereo_pair(5.0)
    surface = np.full((40, 60), 5.2, dtype=np.float32)
    depth, _, _ = stepped(pair["grey"], pair["views"], pair["c"], surface)
    assert np.isnan(depth[:3]).all()
    assert np.isnan(depth[:, -3:]).all()
    assert np.isfinite(depth[3:-4, 8:-8]).all()


def test_the_information_of_a_window_is_the_variance_that_noise_gives_its_depth() -> None:
    rng = np.random.default_rng(3)
    found, stated = [], []
    pair = stereo_pair(5.0)
    start = np.full((40, 60), 5.0, dtype=np.float32)
    for _ in range(30):
        noise_sigma = 4.0
        grey = pair["grey"] + rng.normal(0, noise_sigma, pair["grey"].shape).astype(np.float32)
        views = pair["views"].copy()
        noisy = views + rng.normal(0, noise_sigma, views.shape).astype(np.float32)
        depth, _, information = stepped(grey, noisy, pair["c"], start)
        found.append(depth[10:-10:10, 10:-10:10] - 5.0)
        stated.append(information[10:-10:10, 10:-10:10] ** -0.5)
    # half of the samples count as independent: all of them are here, hence up to sqrt(2) too wide
    assert 0.4 < np.std(found) / np.median(stated) < 1.2
