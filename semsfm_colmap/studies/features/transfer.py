"""Where a point of one image must be in another, from true cameras and the true surface.

Under parallel projection the ray of a pixel starts anywhere on the line ``x_cam = (x, y, *)`` with
``(x, y) = K2^-1 (uv - t) / scale`` and runs along the camera's z. Its first hit on the surface is
the point; it is visible in the other image when the ray from there hits the same place first.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from semsfm_colmap.types import Bool, Float, OrthographicCameras

FirstHit = Callable[[Float, Float], Float]
"""Origins (N, 3), unit directions (N, 3) -> distance (N,) along the ray, inf where it misses."""

VISIBLE_TOLERANCE_PX = 3.0
"""A point this far behind the first hit is still taken to be it: meshes are not exact."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Transfer:
    """True correspondences between the images of a rendered series."""

    cameras: OrthographicCameras
    first_hit: FirstHit
    radius: float
    """All of the surface lies within this distance of the origin, in its own units."""

    def lift(self, image_idx: int, xy: Float) -> Float:
        """Points (K, 3) of the surface seen at the positions (K, 2) px; nan where none is."""
        cameras = self.cameras
        R = cameras.cam_from_world[image_idx]
        scale = cameras.scale_px_per_unit[image_idx]
        flat = np.linalg.solve(cameras.K2, (xy - cameras.translation_px[image_idx]).T).T / scale
        back = np.full((len(xy), 1), -2.0 * self.radius)
        origin = np.hstack([flat, back]) @ R
        direction = np.tile(R[2], (len(xy), 1))
        distance = self.first_hit(origin, direction)
        distance = np.where(np.isfinite(distance), distance, np.nan)
        return np.asarray(origin + distance[:, None] * direction)

    def visible(self, image_idx: int, points: Float) -> Bool:
        """True where nothing hides a point (K, 3) from an image."""
        R = self.cameras.cam_from_world[image_idx]
        ok = np.asarray(np.isfinite(points).all(axis=1))
        start = np.where(ok[:, None], points, 0.0)
        direction = np.tile(R[2], (len(points), 1))
        depth = start @ R[2]
        origin = start - (depth + 2.0 * self.radius)[:, None] * direction
        distance = self.first_hit(origin, direction)
        tolerance = VISIBLE_TOLERANCE_PX / float(self.cameras.scale_px_per_unit[image_idx])
        return np.asarray(ok & (distance >= depth + 2.0 * self.radius - tolerance))

    def predict(self, i: int, j: int, xy: Float) -> Float:
        """Positions (K, 2) px in image j of what image i shows at `xy`; nan where hidden."""
        points = self.lift(i, xy)
        predicted = self.cameras.project(np.nan_to_num(points), np.full(len(xy), j, dtype=np.int64))
        predicted[~self.visible(j, points)] = np.nan
        return predicted

    def angle_deg(self, i: int, j: int) -> float:
        """Angle between the two viewing directions."""
        cosine = self.cameras.viewing_direction[i] @ self.cameras.viewing_direction[j]
        return float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))
