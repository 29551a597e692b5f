"""The databar: its scale, its static part, its readings."""

from __future__ import annotations

import numpy as np
import pytest

from semsfm_colmap.synthetic.databar import (
    BarText,
    draw_databar,
    length_text,
    magnification,
    scale_bar_um,
)
from semsfm_colmap.types import Array

TEXT = BarText(pixel_size_um=0.05, beam_energy_kev=5.0, working_distance_mm=10.2, angle_name="tilt")


def bar(width: int = 1024, rows: int = 60, angle_deg: float = 12.5, frame: int = 3) -> Array:
    return draw_databar(width, rows, TEXT, angle_deg=angle_deg, frame=frame, num_frames=24)


@pytest.mark.parametrize(
    ("longest", "expected"), [(7.0, 5.0), (5.0, 5.0), (4.99, 2.0), (19.0, 10.0), (0.03, 0.02)]
)
def test_the_scale_bar_is_the_longest_round_length_that_fits(
    longest: float, expected: float
) -> None:
    assert scale_bar_um(longest) == pytest.approx(expected)


def test_the_drawn_bar_has_the_length_it_claims() -> None:
    drawn = bar()
    line = drawn[round(0.68 * 60)] == 235
    columns = np.flatnonzero(line)
    # The longest run of lit pixels is the bar; 20 um at 0.05 um are 400 px, too long: 10 um.
    assert np.ptp(columns[columns > 700]) == 200


def test_magnification_is_quoted_for_a_five_inch_print() -> None:
    assert magnification(1000, 0.127) == pytest.approx(1000.0)


def test_lengths_are_spelt_with_a_fitting_unit() -> None:
    assert [length_text(x) for x in (2000.0, 5.0, 0.2)] == ["2 mm", "5 um", "200 nm"]


@pytest.mark.parametrize(("width", "rows"), [(1024, 60), (640, 40), (320, 24), (2048, 120)])
def test_only_the_angle_and_the_frame_number_change(width: int, rows: int) -> None:
    a, b = bar(width, rows, 12.5, 3), bar(width, rows, -60.0, 14)
    pitch = round(0.68 * width / 6)
    changed = np.flatnonzero((a != b).any(axis=0))
    assert changed.size > 0
    assert changed.min() >= 4 * pitch
    assert changed.max() < 6 * pitch


def test_the_bar_is_mostly_black_with_some_bright_text() -> None:
    drawn = bar()
    assert drawn.shape == (60, 1024)
    assert drawn.dtype == np.uint8
    assert 0.02 < np.mean(drawn > 128) < 0.2


def test_a_bar_too_low_for_text_stays_black() -> None:
    assert bar(rows=5).max() == 0
