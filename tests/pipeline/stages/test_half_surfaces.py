"""Surfaces of the odd and the even pictures of a ball, as the densify stage compares them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from semsfm_colmap.config import Config
from semsfm_colmap.io.ply import read_ply_file
from semsfm_colmap.pipeline.executor import ThreadExecutor
from semsfm_colmap.pipeline.project import Project
from semsfm_colmap.pipeline.record import RunRecord
from semsfm_colmap.pipeline.reporter import Reporter
from semsfm_colmap.pipeline.stage import StageRun
from semsfm_colmap.pipeline.stages.half_surfaces import FILE_NAME, compare_halves
from semsfm_colmap.surface.options import SurfaceOptions
from tests.surface.scene import WIDTH, ball_depth, ball_reconstruction, turning_cameras
from tests.surface.scene import write_pictures as write

ANGLES = [-15.0, -12.0, -9.0, -6.0, -3.0, 0.0, 3.0, 6.0, 9.0, 12.0, 15.0]


def run_on(folder: Path) -> StageRun:
    project = Project(folder)
    project.dense.mkdir(parents=True)
    surface = SurfaceOptions(max_depth_map_size_px=WIDTH)
    return StageRun(
        project=project,
        config=replace(Config(), surface=surface),
        reporter=Reporter(verbosity=-1),
        record=RunRecord(path=project.record),
        executor=ThreadExecutor(1),
    )


def test_the_halves_of_a_ball_lie_closer_together_than_their_error_bars_say(
    tmp_path: Path,
) -> None:
    on = run_on(tmp_path)
    cameras = turning_cameras(ANGLES)
    depths = [ball_depth(cameras, i) for i in range(len(ANGLES))]
    names = write(on.project.images, cameras, depths)
    said = compare_halves(on, ball_reconstruction(cameras, names))
    assert said is not None
    assert said.shared > 0.8
    assert 0.01 < said.robust_rms_px < 0.5
    assert abs(said.median_px) < 0.2
    assert said.ratio == pytest.approx(said.robust_rms_px / said.expected_px, rel=0.7)
    rows = read_ply_file(on.project.dense / FILE_NAME).vertices
    assert len(rows) == said.num_points[0]
    assert np.isfinite(rows["difference"]).mean() == pytest.approx(said.shared)
    # the depth maps of the halves are not kept
    assert [p.name for p in on.project.dense.iterdir()] == [FILE_NAME]


def test_three_images_are_too_few_for_two_surfaces_and_an_old_one_goes(tmp_path: Path) -> None:
    on = run_on(tmp_path)
    (on.project.dense / FILE_NAME).write_bytes(b"of an earlier run")
    cameras = turning_cameras(ANGLES[:3])
    assert compare_halves(on, ball_reconstruction(cameras, ("a", "b", "c"))) is None
    assert not (on.project.dense / FILE_NAME).exists()
