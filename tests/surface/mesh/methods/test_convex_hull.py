"""The convex hull."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from semsfm_colmap.errors import InputError
from semsfm_colmap.surface.mesh.measure import measure
from tests.surface.mesh.methods.contract import MesherContract, sheet
from tests.surface.scene import RADIUS


class TestConvexHull(MesherContract):
    method = "convex-hull"
    inside = np.array([0.0, 0.0, 0.5 * RADIUS])

    def test_a_plane_is_its_surface(self, tmp_path: Path) -> None:
        with pytest.raises(InputError, match="encloses no volume"):
            self.mesh(sheet())

    def test_hull_of_a_cube_has_its_volume_and_area(self) -> None:
        corners = np.array([[x, y, z] for x in (0, 2.0) for y in (0, 2.0) for z in (0, 2.0)])
        inner = np.random.default_rng(0).uniform(0.1, 1.9, (40, 3))
        from semsfm_colmap.types import PointCloud

        points = np.concatenate([corners, inner])
        mesh = self.mesh(PointCloud(points=points, normals=np.tile([0.0, 0.0, 1.0], (48, 1))))
        size = measure(mesh)
        assert len(mesh.vertices) == 8
        assert size.volume == pytest.approx(8.0)
        assert size.area == pytest.approx(24.0)
        assert size.hull_volume == pytest.approx(8.0)
        assert size.hull_area == pytest.approx(24.0)
