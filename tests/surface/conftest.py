"""What several tests of the surface start from."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from semsfm_colmap.types import DepthMap, Reconstruction
from tests.surface.scene import (
    ball_depth_maps,
    ball_reconstruction,
    turning_cameras,
    write_pictures,
)

ANGLES = list(np.arange(0.0, 360.0, 12.0))


@pytest.fixture(scope="session")
def round_ball(
    tmp_path_factory: pytest.TempPathFactory,
) -> tuple[Reconstruction, list[DepthMap], Path]:
    """A ball seen from all around, its true depth maps, and the folder of its pictures."""
    cameras = turning_cameras(ANGLES)
    folder = tmp_path_factory.mktemp("ball")
    maps = ball_depth_maps(cameras, tuple(f"view_{i:02d}.png" for i in range(len(ANGLES))))
    names = write_pictures(folder, cameras, [np.array(m.depth, dtype=float) for m in maps])
    return ball_reconstruction(cameras, names, 6000), maps, folder
