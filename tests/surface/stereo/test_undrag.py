"""Depth maps without the drag of shading, against a displaced pattern in closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.surface.stereo.undrag import depth_without_drag
from semsfm_colmap.types import DepthMap
from tests.surface.scene import (
    RADIUS,
    SCALE,
    ball_depth,
    ball_reconstruction,
    pixel_rays,
    turning_cameras,
)

CAMERAS = turning_cameras([0.0, 5.0])
NAMES = ("a", "b")


def true_map() -> DepthMap:
    depth = ball_depth(CAMERAS, 0).astype(np.float32)
    return DepthMap(image_name="a", depth=depth, confidence=np.isfinite(depth).astype(np.float32))


@pytest.mark.parametrize("tilt_deg", [0.0, 30.0, 60.0])
def test_the_shift_is_that_of_two_close_views_of_a_displaced_pattern(tilt_deg: float) -> None:
    """Surface point at the origin, normal at tilt phi: displaced by c sin cos, triangulated."""
    c, d = 1.0, 1e-4
    phi = np.radians(tilt_deg)
    seen = np.array([c * np.sin(a) * np.cos(a) for a in (phi, phi + d)])
    # along the image's axis: h sin(a) + g cos(a) of a shift h along the normal, g down the slope
    h, _ = np.linalg.solve([[np.sin(a), np.cos(a)] for a in (phi, phi + d)], seen)
    assert h == pytest.approx(c * np.cos(phi) ** 3, abs=1e-3)


def test_a_frontal_surface_moves_inward_by_the_coefficient_and_a_steep_one_little() -> None:
    model = replace(ball_reconstruction(CAMERAS, NAMES), drag_px=2.0)
    before = true_map()
    after = depth_without_drag(before, model, 0, 3)
    start, direction = pixel_rays(CAMERAS, 0)
    known = np.isfinite(after.depth)
    points = start[known] + after.depth[known][:, None] * direction
    inward_px = SCALE * (RADIUS - np.linalg.norm(points, axis=1))
    cosine = -before.depth[known] / RADIUS
    frontal, steep = cosine > 0.98, (cosine > 0.45) & (cosine < 0.55)
    assert np.median(inward_px[frontal]) == pytest.approx(2.0, rel=0.05)
    assert np.median(inward_px[steep]) == pytest.approx(2.0 * 0.125, rel=0.25)


@pytest.mark.parametrize("drag_px", [None, 0.0, -0.5])
def test_no_drag_and_one_uphill_leave_the_map_alone(drag_px: float | None) -> None:
    model = replace(ball_reconstruction(CAMERAS, NAMES), drag_px=drag_px)
    before = true_map()
    assert depth_without_drag(before, model, 0, 3) is before
