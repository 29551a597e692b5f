from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from semsfm_colmap.ingest.inspect.inspection import inspect_images
from semsfm_colmap.ingest.inspect.neighbours import drifted
from semsfm_colmap.ingest.inspect.overlap import Overlap
from tests.ingest.inspect.views import (
    HEIGHT,
    OPTIONS,
    TILTS,
    WIDTH,
    answer,
    view,
    warned,
    write_series,
)

SHEARS = [0.1, -0.3, 0.2, 0.4, -0.2, 0.1, -0.4, 0.3, 0.2, -0.1]
"""Percent against the frame before: noise of the fits."""


def overlap_of(shear_percent: float) -> Overlap:
    linear = np.array([[1.0, shear_percent / 100], [0.0, 1.0]])
    return Overlap(num_agreeing=40, linear=linear, shift_px=np.zeros(2), parallax_px=1.0)


def turned(turn_deg: float, shear: float) -> list[Overlap]:
    """The fourth of seven frames turned, then sheared."""
    c, s = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    step = np.array([[1.0, shear], [0.0, 1.0]]) @ np.array([[c, -s], [s, c]])
    steps = [np.eye(2), np.eye(2), step, np.linalg.inv(step), np.eye(2), np.eye(2)]
    return [Overlap(num_agreeing=40, linear=m, shift_px=np.zeros(2), parallax_px=1) for m in steps]


def test_drift_within_a_frame_is_found(folder: Path) -> None:
    images = [view(t, i) for i, t in enumerate(TILTS)]
    shear = np.array([[1, 0.02, 0], [0, 1, 0]], np.float32)
    images[3] = cv2.warpAffine(images[3], shear, (WIDTH, HEIGHT), borderMode=cv2.BORDER_REFLECT)
    write_series(folder, images)
    assert warned(inspect_images(folder, OPTIONS), "drifted") == ["3.png"]


@pytest.mark.parametrize("count", [6, 11])
@pytest.mark.parametrize("frame", [0, 2, -1])
def test_the_frame_that_is_sheared_against_both_neighbours_has_drifted(
    count: int, frame: int
) -> None:
    shear = np.concatenate([[0.0], np.cumsum(SHEARS[: count - 1])]) + 3.0 * np.arange(count)
    shear[frame] -= 2.5
    names = [f"{i}" for i in range(count)]
    found = drifted(names, [1000.0] * count, [overlap_of(s) for s in np.diff(shear)])
    assert list(found) == [names[frame]]
    assert "sheared by -2." in found[names[frame]]


@pytest.mark.parametrize(
    "steps",
    [
        [2.1, 2.2, 2.6, 3.0],  # the shear of a turn grows, and the last frame has only grown
        [6.3, 6.9, 20.3, 6.1, 19.0, 5.8, 5.5, 8.7, 19.1, 21.2, 8.1, 5.4, 5.8, 22.0],
        [-9.0, 4.0, -3.0, 5.0, 4.0, 1.0, 2.0],
    ],
)
def test_the_last_frame_of_steps_that_grow_or_jump_has_not_drifted(steps: list[float]) -> None:
    names = [str(k) for k in range(len(steps) + 1)]
    for each in (steps, steps[::-1]):
        found = drifted(names, [1000.0] * len(names), [overlap_of(s / 100) for s in each])
        assert not {names[0], names[-1]} & set(found)


def test_noisy_steps_and_too_few_frames_are_no_drift() -> None:
    noisy = np.random.default_rng(1).normal(0, 0.9, 47)
    names = [f"{i}" for i in range(48)]
    assert drifted(names, [1000.0] * 48, [overlap_of(s) for s in noisy]) == {}
    assert drifted(names[:4], [1000.0] * 4, [overlap_of(s) for s in (0, 2, -2)]) == {}  # which one?


@pytest.mark.parametrize("place", [2, 3, 5])
def test_a_frame_out_of_order_is_found(folder: Path, place: int) -> None:
    tilts = [-15, -12, -9, -6, -3, 0, 3, 6]
    tilts.insert(place, 12)
    write_series(folder, [view(t, i) for i, t in enumerate(tilts)])
    inspection = inspect_images(folder, OPTIONS)
    assert warned(inspection, "out of order") == [f"{place}.png"]
    assert warned(inspection, "drifted") == []
    assert answer(inspection, "frames in order") == "no"


def test_uneven_steps_are_in_order(folder: Path) -> None:
    tilts = [-14, -12, -10, -4, 2, 4, 6, 12, 14]
    write_series(folder, [view(t, i) for i, t in enumerate(tilts)])
    assert warned(inspect_images(folder, OPTIONS), "out of order") == []


def test_a_frame_at_another_angle_is_not_called_drifted() -> None:
    names = [f"{i}" for i in range(7)]
    overlaps = turned(0.0, 0.02)
    overlaps[3] = replace(overlaps[3], parallax_px=2.0)
    assert drifted(names, [1000.0] * 7, overlaps) == {}


@pytest.mark.parametrize("turn_deg", [0.0, 3.0, -20.0, 90.0, 180.0])
def test_a_turned_frame_has_not_drifted(turn_deg: float) -> None:
    names = [f"{i}" for i in range(7)]
    assert drifted(names, [1000.0] * 7, turned(turn_deg, 0.0)) == {}


@pytest.mark.parametrize("turn_deg", [0.0, 3.0, -20.0, 180.0])
def test_a_frame_that_is_turned_and_sheared_has_drifted(turn_deg: float) -> None:
    names = [f"{i}" for i in range(7)]
    assert list(drifted(names, [1000.0] * 7, turned(turn_deg, 0.02))) == ["3"]
