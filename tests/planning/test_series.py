import numpy as np
import pytest

from semsfm_colmap.errors import InputError
from semsfm_colmap.planning.options import NoiseOptions, SpecimenOptions
from semsfm_colmap.planning.series import (
    SeriesSize,
    alternatives,
    best_within_limits,
    curves,
    fewest_frames,
    plan_series,
    totals_deg,
)

FIELD = SpecimenOptions(specimen="field", max_total_deg=40.0, max_frames=16)
NOISE = NoiseOptions()


def test_a_turn_has_a_step_from_its_last_image_to_the_first():
    assert SeriesSize(num_frames=13, total_deg=60.0).step_deg == 5.0
    turn = SeriesSize(num_frames=36, total_deg=360.0)
    assert turn.step_deg == 10.0
    assert turn.range_deg == 350.0


@pytest.mark.parametrize(("total", "frames"), [(10.0, 3), (30.0, 3), (45.0, 4), (360.0, 24)])
def test_no_step_is_larger_than_allowed(total, frames):
    assert fewest_frames(total, SpecimenOptions(max_step_deg=15.0)) == frames


def test_a_field_is_not_turned_further_than_it_is_seen():
    limits = SpecimenOptions(specimen="field")
    assert max(totals_deg(limits, NoiseOptions(visible_deg=40.0))) == 80.0


def test_more_images_and_larger_angles_lower_the_sigma():
    def sigma(frames, total):
        series = plan_series(SeriesSize(num_frames=frames, total_deg=total), FIELD, NOISE)
        assert series is not None
        return series.prediction.median_px

    assert sigma(5, 20.0) > sigma(9, 20.0) > sigma(9, 40.0)


def test_alternatives_reach_the_wanted_sigma_with_the_fewest_images_cheapest_first():
    found = alternatives(0.5, FIELD, NOISE)
    assert found
    cost = [series.size.num_frames for series in found]
    assert cost == sorted(cost)
    for series in found:
        size = series.size
        assert series.prediction.median_px <= 0.5
        if size.num_frames > fewest_frames(size.total_deg, FIELD):
            fewer = SeriesSize(num_frames=size.num_frames - 1, total_deg=size.total_deg)
            one_less = plan_series(fewer, FIELD, NOISE)
            assert one_less is None or one_less.prediction.median_px > 0.5


def test_what_no_series_reaches_has_no_alternatives_and_a_best():
    best = best_within_limits(FIELD, NOISE)
    wanted = 0.9 * best.prediction.median_px
    assert alternatives(wanted, FIELD, NOISE) == []
    assert best.size == SeriesSize(num_frames=16, total_deg=40.0)


def test_limits_that_allow_no_model_are_said():
    narrow = SpecimenOptions(max_total_deg=360.0, max_frames=3, max_step_deg=1.0)
    with pytest.raises(InputError, match="--max_step_deg"):
        best_within_limits(narrow, NOISE)


def test_steps_so_large_that_no_point_is_seen_three_times_give_no_series():
    assert plan_series(SeriesSize(num_frames=3, total_deg=300.0), SpecimenOptions(), NOISE) is None


def test_the_curves_of_a_figure_fall_and_keep_within_the_limits():
    for total, series in curves(FIELD, NOISE).items():
        frames = [s.size.num_frames for s in series]
        assert fewest_frames(total, FIELD) <= frames[0]
        assert frames[-1] == FIELD.max_frames
        sigma = [s.prediction.median_px for s in series]
        assert np.all(np.diff(sigma) < 0.0)
