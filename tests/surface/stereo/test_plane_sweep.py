"""The sweep of a surface over a base that has flaws."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from semsfm_colmap.surface.options import SurfaceOptions
from semsfm_colmap.surface.stereo.level import read_level
from semsfm_colmap.surface.stereo.plane_sweep import sweep_depths
from semsfm_colmap.surface.stereo.rasters import raster_reader
from semsfm_colmap.types import Bool
from tests.surface.scene import (
    SCALE,
    WIDTH,
    plane_depth,
    reconstruction_of,
    turning_cameras,
    write_pictures,
)


def test_holes_of_the_base_do_not_move_the_surface_beside_them(tmp_path: Path) -> None:
    """Not even where the rest of the specimen lies far to one side."""
    cameras = turning_cameras([-12.0, -8.0, -4.0, 0.0, 4.0, 8.0, 12.0])
    truth = [plane_depth(cameras, i, np.array([0.0, 0.0, -1.0])) for i in range(7)]
    names = write_pictures(tmp_path, cameras, truth, noise=25.0)
    reconstruction = reconstruction_of(cameras, names, np.zeros((3, 3)))
    sizes = reconstruction.image_size_px
    reader = raster_reader(tmp_path, None, names, sizes, WIDTH, 7)
    level = read_level(reconstruction, 3, np.array([0, 1, 2, 4, 5, 6]), reader)
    y, x = np.indices(level.grey.shape)
    holes = (y // 4 % 2 == 0) & (x // 4 % 2 == 0) & (x < WIDTH // 2)
    beside = ~holes & (x > 10) & (x < WIDTH // 2 - 10) & (y > 10) & (y < len(y) - 10)

    def mean_error(far: float, known: Bool) -> float:
        base = np.zeros((3, *level.grey.shape), dtype=np.float32)
        base[0] = truth[3] + np.where(x < WIDTH // 2, 0.0, far / SCALE)
        base[:, ~known] = np.nan
        depth, _ = sweep_depths(level, base, 15.0 / SCALE, SurfaceOptions())
        np.testing.assert_array_equal(np.isfinite(depth), known)
        return float(np.mean(SCALE * (depth - truth[3])[beside]))

    for far in (-20.0, -60.0, 20.0, 60.0):
        assert abs(mean_error(far, ~holes) - mean_error(far, np.ones_like(holes))) < 0.1
