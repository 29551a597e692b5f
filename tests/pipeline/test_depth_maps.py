"""Depth maps that a run had made before it was cut off."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from semsfm_colmap.pipeline.depth_maps import write_depth_maps
from semsfm_colmap.surface.files import depth_map_path
from semsfm_colmap.surface.stereo import depth_maps as stereo
from tests.pipeline.stages.test_half_surfaces import run_on
from tests.surface.scene import ball_depth, ball_reconstruction, turning_cameras, write_pictures

ANGLES = [-6.0, -3.0, 0.0, 3.0, 6.0]


def test_only_the_missing_ones_are_made_and_they_are_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    on = run_on(tmp_path)
    cameras = turning_cameras(ANGLES)
    written = write_pictures(on.project.images, cameras, [ball_depth(cameras, i) for i in range(5)])
    reconstruction = ball_reconstruction(cameras, written)
    references = np.array([1, 2, 3])
    names = write_depth_maps(on, reconstruction, references, tmp_path / "maps", "maps")
    assert names == tuple(written[1:4])
    files = [depth_map_path(tmp_path / "maps", name) for name in names]
    whole = [np.load(file)["depth"] for file in files]
    files[1].unlink()
    stamp = files[0].stat().st_mtime_ns

    asked = []
    sweep = stereo.sweep_depth_maps

    def noted(model, some, *rest, **options):  # type: ignore[no-untyped-def]
        asked.append(some.tolist())
        return sweep(model, some, *rest, **options)

    monkeypatch.setattr(stereo, "sweep_depth_maps", noted)
    again = write_depth_maps(on, reconstruction, references, tmp_path / "maps", "maps")
    assert again == names
    assert asked == [[2]]
    assert files[0].stat().st_mtime_ns == stamp
    np.testing.assert_array_equal(np.load(files[1])["depth"], whole[1])
