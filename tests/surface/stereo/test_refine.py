"""Pixels between those that a step moves."""

from __future__ import annotations

import numpy as np

from semsfm_colmap.surface.stereo.refine import _move_between


def test_pixels_between_move_as_their_neighbours_do() -> None:
    y, x = np.mgrid[0:12, 0:15].astype(np.float32)
    truth = 0.02 * x**2 - 0.01 * x * y + 5.0
    between = (x + y) % 2 == 1
    # local planes flatten a bent surface alike everywhere; steps take that back where they are made
    before = truth + 0.3
    depth = np.where(between, before, truth)
    score = np.where(between, 0.0, 0.1 * y).astype(np.float32)
    information = np.where(between, 0.0, 4.0).astype(np.float32)
    _move_between(before, depth, score, information)
    np.testing.assert_allclose(depth, truth, atol=1e-6)
    np.testing.assert_allclose(score[1:-1, 1:-1], 0.1 * y[1:-1, 1:-1], atol=1e-6)
    np.testing.assert_allclose(information, 4.0)


def test_a_pixel_with_one_neighbour_is_not_known() -> None:
    depth = np.full((3, 4), np.nan, dtype=np.float32)
    depth[0, 0] = depth[0, 2] = depth[2, 0] = 2.0
    score, information = np.ones_like(depth), np.ones_like(depth)
    _move_between(np.full_like(depth, 2.5), depth, score, information)
    assert depth[0, 1] == 2.0
    assert depth[1, 0] == 2.0
    assert np.isnan(depth[0, 3])
    assert score[0, 3] == information[0, 3] == 0.0
    assert np.isnan(depth[2, 1])


def test_what_has_no_plane_has_no_depth() -> None:
    depth = np.full((3, 3), 2.0, dtype=np.float32)
    before = np.full_like(depth, 2.0)
    before[0, 1] = np.nan
    _move_between(before, depth, np.ones_like(depth), np.ones_like(depth))
    assert np.isnan(depth[0, 1])
    assert np.isfinite(depth).sum() == 8
