"""The rows of the profile's tables, from figures with a known sum."""

import cProfile
import time

from benchmarks.profile import Measured, function_rows, functions_of, stage_row


def busy(seconds):
    end = time.process_time() + seconds
    while time.process_time() < end:
        pass


def outer():
    busy(0.05)


def test_a_function_has_its_own_processor_time_and_not_that_of_those_it_calls():
    profiler = cProfile.Profile(time.process_time)
    profiler.runcall(outer)
    own = {name: (calls, seconds) for name, calls, seconds in functions_of(profiler)}
    spent = sum(seconds for name, (_, seconds) in own.items() if "outer" not in name)
    assert spent > 0.04
    assert own["test_profile.outer"][1] < 0.01
    assert own["test_profile.busy"][0] == 1


def test_a_stage_is_told_a_frame_and_a_megapixel():
    value = Measured(wall_s=9.0, cpu_s=12.0, peak_mb=300.4, functions=())
    row = stage_row("a", "map", value, 24, 6.0)
    assert row == ["a", "map", "9.0", "12.0", "500", "2000", "300"]


def test_functions_of_little_weight_have_no_row():
    functions = (("a.long", 3, 8.5), ("a.short", 100, 0.5), ("a.middle", 1, 1.0))
    value = Measured(wall_s=0.0, cpu_s=0.0, peak_mb=0.0, functions=functions)
    rows = function_rows("s", "map", value)
    assert [row[2:] for row in rows] == [
        ["`a.long`", "3", "8.5", "85 %"],
        ["`a.middle`", "1", "1.0", "10 %"],
    ]
