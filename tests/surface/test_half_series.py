"""Two surfaces of disjoint halves of the frames, compared."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from semsfm_colmap.io.ply import read_ply_file
from semsfm_colmap.surface.files import write_half_difference
from semsfm_colmap.surface.half_series import (
    figures,
    fused_spacing,
    half_difference,
    halves,
    part_of,
)
from semsfm_colmap.surface.options import SurfaceOptions
from semsfm_colmap.types import PointCloud
from tests.surface.scene import RADIUS, SCALE, ball_points, reconstruction_of, turning_cameras

SPACING = 0.08


def shell(
    seed: int, outward: float = 0.0, noise: float = 0.0, sigma: float = 0.01, num: int = 12_000
) -> PointCloud:
    points = ball_points(num, seed)
    normals = points / RADIUS
    height = outward + noise * np.random.default_rng(seed).normal(size=(num, 1))
    return PointCloud(points=points + height * normals, normals=normals, sigma=np.full(num, sigma))


def test_a_shift_of_one_half_is_the_difference_with_its_sign() -> None:
    found = half_difference(shell(1), shell(2, outward=0.03), SPACING)
    assert found.share > 0.99
    assert np.median(found.difference) == pytest.approx(0.03, rel=0.05)
    assert found.rms == pytest.approx(0.03, rel=0.1)
    said = figures(found, 12_000, 1.0 / SCALE)
    assert said is not None
    assert said.median_px == pytest.approx(0.6, rel=0.05)
    assert said.ratio == pytest.approx(0.03 * 1.4826 / np.hypot(0.01, 0.01), rel=0.05)


def test_noise_that_the_error_bars_know_of_gives_a_ratio_of_one() -> None:
    odd, even = shell(1, noise=0.01), shell(2, noise=0.01)
    # the surface of the other half is a mean of some nine of its points
    averaged = replace(even, sigma=even.sigma / 3.0)
    ratio = half_difference(odd, averaged, SPACING).ratio
    assert 0.85 < ratio < 1.15
    assert half_difference(replace(odd, sigma=2.0 * odd.sigma), even, SPACING).ratio < 0.7 * ratio


def test_the_other_side_of_a_sheet_and_a_far_surface_are_not_compared() -> None:
    front = shell(1)
    back = replace(shell(2, outward=0.01), normals=-shell(2).normals)
    assert half_difference(front, back, SPACING).share == 0.0
    far = half_difference(front, shell(2, outward=5.0 * SPACING), SPACING)
    assert far.share == 0.0
    assert figures(far, 12_000, 1.0) is None
    nothing = PointCloud(points=np.zeros((0, 3)), normals=np.zeros((0, 3)), sigma=np.zeros(0))
    assert half_difference(front, nothing, SPACING).share == 0.0
    assert half_difference(nothing, front, SPACING).share == 0.0


def test_half_of_a_model_has_half_of_its_images_and_what_they_see() -> None:
    points = ball_points(50)
    visible = np.ones((5, 50), dtype=bool)
    visible[::2, 40:] = False
    model = reconstruction_of(
        turning_cameras([0, 5, 10, 15, 20]), tuple("abcde"), points, visible,
        drift_px=np.arange(10.0).reshape(5, 2),
    )  # fmt: skip
    odd, even = (part_of(model, images) for images in halves(5))
    assert odd.image_names == ("a", "c", "e")
    assert even.image_names == ("b", "d")
    assert len(odd.points) == 40
    assert len(even.points) == 50
    np.testing.assert_array_equal(even.drift_px, [[2.0, 3.0], [6.0, 7.0]])
    np.testing.assert_allclose(odd.residuals(), 0.0, atol=1e-9)


def test_the_spacing_is_in_px_of_reduced_maps() -> None:
    model = reconstruction_of(turning_cameras([0, 5]), ("a", "b"), ball_points(9))
    assert fused_spacing(model, SurfaceOptions()) == pytest.approx(2.0 / SCALE)
    half = SurfaceOptions(max_depth_map_size_px=80)
    assert fused_spacing(model, half) == pytest.approx(4.0 / SCALE)


def test_the_difference_is_a_property_of_the_file(tmp_path: Path) -> None:
    found = half_difference(shell(1, num=500), shell(2, outward=0.02, num=500), 0.4)
    write_half_difference(tmp_path / "half_series.ply", found)
    rows = read_ply_file(tmp_path / "half_series.ply").vertices
    np.testing.assert_allclose(rows["difference"], found.difference, rtol=1e-6)
    outside = found.compared & (found.difference > 0)
    assert (rows["red"] >= rows["blue"])[outside].all()
