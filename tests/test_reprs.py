"""Objects at a prompt: one screen, whatever they hold."""

from pathlib import Path

import semsfm_colmap as semsfm
from semsfm_colmap.pipeline.record import RunRecord, StageEntry
from semsfm_colmap.types import SemFrame, SemSeries
from tests.report.series import make_reconstruction

LINES, COLUMNS = 40, 100


def fits(value):
    lines = repr(value).splitlines()
    return len(lines) <= LINES and all(len(line) <= COLUMNS for line in lines)


def test_a_model_of_any_size_is_a_screen_of_shapes():
    model = make_reconstruction([4.0 * k for k in range(10)])
    assert fits(model)
    assert "points: float64 (" in repr(model)
    assert "image_names: 10 of them: " in repr(model)
    assert "  cameras: OrthographicCameras(\n    cam_from_world: float64 (10, 3, 3)" in repr(model)


def test_a_series_of_many_frames_is_a_screen():
    frame = SemFrame(
        name="a.tif", width_px=9, height_px=9, source_path="a.tif", crop_px=(0, 0, 9, 9)
    )
    series = SemSeries(frames=(frame,) * 500)
    assert fits(series)
    assert "500 of them: SemFrame" in repr(series)


def test_options_are_shown_by_what_is_not_at_its_default_and_made_again_from_it():
    assert repr(semsfm.Config()) == "Config()"
    config = semsfm.Config(seed=3, matching=semsfm.MatchingOptions(max_error_px=1.25))
    assert repr(config) == "Config(matching=MatchingOptions(max_error_px=1.25), seed=3)"
    names = {name: getattr(semsfm, name) for name in ("Config", "MatchingOptions")}
    assert eval(repr(config), names) == config


def test_a_run_is_a_line_a_stage():
    entry = StageEntry(status="done", seconds=2.25, summary={"notes": ["x"] * 1000})
    record = RunRecord(path=Path("p/run.json"), stages={"ingest": entry, "map": entry})
    assert repr(record) == "RunRecord(p/run.json\n  ingest: done, 2.2 s\n  map: done, 2.2 s\n)"
