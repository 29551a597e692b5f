"""Images without the drift of their scan."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from semsfm_colmap.geometry.scan_drift import without_drift as places_without_drift
from semsfm_colmap.surface.stereo.rasters import raster_reader
from semsfm_colmap.surface.stereo.undrift import drift_of, drifted, without_drift
from semsfm_colmap.types import Array, Float

HEIGHT, WIDTH = 120, 160
STEEPEST = 40.0 * np.hypot(0.31, 0.2) + 30.0 * np.hypot(0.27, 0.11)
"""Largest change of the pattern's grey a px."""
GRID_PX = np.sqrt(2.0) / 64.0
"""OpenCV interpolates at 32nds of a px."""


def pattern(u: Float, v: Float) -> Float:
    """Grey at a place of the frame without drift; COLMAP's pixel centres are at one half."""
    return np.asarray(
        120.0 + 40.0 * np.sin(0.31 * u + 0.2 * v) + 30.0 * np.cos(0.27 * v - 0.11 * u)
    )


def scanned(drift: tuple[float, float]) -> Array:
    """What a scan with this drift records: at each pixel the place that it was really at."""
    x, y = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    seen = np.column_stack([x.ravel(), y.ravel()])
    there = places_without_drift(seen, np.array([drift]), np.full(len(seen), float(HEIGHT)))
    return pattern(*there.T).reshape(HEIGHT, WIDTH)


def straight() -> Float:
    return pattern(*np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5))


def test_a_drift_is_taken_out_to_a_64th_of_a_pixel() -> None:
    for drift in ((1.5, -0.8), (-0.6, 0.0), (0.0, 0.6)):
        image = scanned(drift)
        inner = np.s_[6:-6, 6:-6]
        before = np.abs(image - straight())[inner].max()
        after = np.abs(without_drift(image, drift) - straight())[inner].max()
        assert after < STEEPEST * GRID_PX < 0.2 * before, drift


def test_the_other_sign_makes_it_worse() -> None:
    image = scanned((1.5, -0.8))
    inner = np.s_[6:-6, 6:-6]
    worse = np.abs(without_drift(image, (-1.5, 0.8)) - straight())[inner].mean()
    assert worse > 1.5 * np.abs(image - straight())[inner].mean()


def test_a_mask_stays_a_mask() -> None:
    mask = np.zeros((HEIGHT, WIDTH), dtype=np.uint8)
    mask[:, 80:] = 1
    moved = without_drift(mask, (4.0, 0.0), nearest=True)
    assert set(np.unique(moved)) == {0, 1}
    assert moved[-1].sum() == mask[-1].sum() + 2
    assert moved[0].sum() == mask[0].sum() - 2


def test_the_reader_takes_out_each_image_s_own_drift(tmp_path: Path) -> None:
    drifts = np.array([[0.0, 0.0], [1.5, -0.8]])
    for k, name in enumerate("ab"):
        cv2.imwrite(str(tmp_path / f"{name}.png"), np.rint(scanned(tuple(drifts[k]))))
    sizes = np.tile([WIDTH, HEIGHT], (2, 1))
    read = raster_reader(tmp_path, None, ("a.png", "b.png"), sizes, WIDTH, 2, drifts)
    off = (read(0).grey - read(1).grey)[6:-6, 6:-6]
    # what is left is the rounding to whole greys
    assert np.sqrt(np.mean(off**2)) < 0.7
    assert drift_of(None, 1) == (0.0, 0.0)
    assert drift_of(drifts, 1) == (1.5, -0.8)


def test_what_is_drifted_is_where_the_mapping_takes_the_drift_out() -> None:
    rng = np.random.default_rng(0)
    straight_px = rng.uniform(0.0, 120.0, (50, 2))
    there = drifted(straight_px, (3.0, -2.0), HEIGHT)
    assert np.abs(there - straight_px).max() > 1.0
    back = places_without_drift(there, np.array([[3.0, -2.0]]), np.full(50, float(HEIGHT)))
    np.testing.assert_allclose(back, straight_px, atol=1e-9)
