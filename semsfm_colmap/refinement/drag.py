"""Drag: features that shading pulls along the slopes, as a part of the camera model.

A scanning electron microscope shows slopes brighter, so that on a specimen that turns the pattern
that is matched is not quite fixed to the surface: between a frontal and an inclined view it slides
downhill. With n the outward unit normal of a point in the camera's frame and ``n_c = -n_z`` the
cosine to the viewer, an observation is seen at

    xy = q + c f,    f = n_c (n_x, n_y),    q = s K2 (R X)[:2] + t,

with one coefficient c in px for all images. (A shift by ``(n_x, n_y)`` alone is one of the point
along its normal and leaves no trace.) To the cameras a drag looks like a rotation that is too large
or too small, so that it is estimated together with them, with a prior of 1 px.

The normals come from the points, which the cameras place; the field changes little with either, so
that both are held while c is estimated, and neither's derivative is taken.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from semsfm_colmap.geometry.eliminated import Displacing
from semsfm_colmap.geometry.normals import estimate_normals
from semsfm_colmap.geometry.threads import threads_for
from semsfm_colmap.refinement.adjustment import PoseModel
from semsfm_colmap.refinement.drag_kernels import fill_drag_field
from semsfm_colmap.refinement.shared_scalar import SharedScalarModel
from semsfm_colmap.types import Float, Int, Observations, OrthographicCameras

P = TypeVar("P")

DRAG_SIGMA_PX = 1.0
"""Standard deviation of the coefficient's prior: rendered grains have 0.4 to 1.0 px."""
MISFIT_DEG = 30.0
MISFIT_PX = 1.0
"""At so small a rotation the coefficient is so uncertain, whatever its formal error."""
DOUBT_SHARE = 0.25
"""Standard deviation of what the coefficient leaves, as a share of it: shading is no law."""
DOUBT_FLOOR_PX = 0.25
"""The same where it is zero."""
NUM_NEIGHBORS = 30
"""Points that a normal is fitted to."""
MIN_POINTS = 50
"""Fewer points do not give normals."""


def drag_field(cam_from_world: Float, normals: Float, image_idx: Int, track_idx: Int) -> Float:
    """The module's f of each observation: (O, 2), between -1/2 and 1/2.

    Parameters
    ----------
    cam_from_world : (M, 3, 3)
    normals : (N, 3) outward, in the world; zero where it is not known

    """
    out = np.empty((len(image_idx), 2))
    with threads_for(len(image_idx)):
        fill_drag_field(np.ascontiguousarray(cam_from_world), normals, image_idx, track_idx, out)
    return out


def seen_normals(points: Float, cameras: OrthographicCameras, observations: Observations) -> Float:
    """Outward normals (N, 3) of the points, on the side of the cameras that see them.

    Parameters
    ----------
    points : (N, 3), one for each track of `observations`

    """
    if len(points) < MIN_POINTS:
        return np.zeros_like(points)
    obs = observations
    direction = cameras.viewing_direction[obs.image_idx]
    mean = np.stack(
        [np.bincount(obs.track_idx, direction[:, k], minlength=len(points)) for k in range(3)],
        axis=1,
    )
    length = np.linalg.norm(mean, axis=1, keepdims=True)
    return estimate_normals(points, mean / np.where(length > 0, length, 1.0), NUM_NEIGHBORS)


@dataclass(frozen=True, kw_only=True, eq=False)
class DragModel(SharedScalarModel[P]):
    """`CameraModel` of another one's parameters and the coefficient of the drag."""

    cam_from_world: Float
    """(M, 3, 3) for the field only"""
    normals: Float
    """(N, 3)"""
    sigma: float = DRAG_SIGMA_PX
    """of the coefficient's prior, px"""

    @classmethod
    def build(
        cls,
        base: PoseModel[P],
        cameras: OrthographicCameras,
        points: Float,
        observations: Observations,
        sigma: float = DRAG_SIGMA_PX,
    ) -> DragModel[P]:
        """With the normals of the points, on the side of the cameras that see them."""
        return cls(
            base=base,
            cam_from_world=np.asarray(cameras.cam_from_world),
            normals=seen_normals(points, cameras, observations),
            sigma=sigma,
        )

    def displacement(self, params: tuple[P, float], image_idx: Int, track_idx: Int) -> Float:
        """(O, 2) px: what is added to the image of an affine camera, the base's with it."""
        shown = params[1] * self.field(image_idx, track_idx)
        if isinstance(self.base, Displacing):
            shown = shown + self.base.displacement(params[0], image_idx, track_idx)
        return shown

    def slope(self, params: tuple[P, float], image_idx: Int, track_idx: Int) -> Float:
        """The field, whatever the coefficient."""
        return self.field(image_idx, track_idx)

    def field(self, image_idx: Int, track_idx: Int) -> Float:
        """The module's f."""
        return drag_field(self.cam_from_world, self.normals, image_idx, track_idx)


def misfit_px(rotation_deg: float) -> float:
    """What else the coefficient takes up at a small rotation, px.

    The drag shows in the second order of the angle, and there distortion and an axis of view that
    is not quite the same everywhere look alike: real series of 9 to 18 degrees give -3 to 1 px at
    formal errors of 0.1.
    """
    return MISFIT_PX * (MISFIT_DEG / max(rotation_deg, 1e-3)) ** 2


def doubt_px(coefficient_px: float) -> float:
    """Standard deviation of the coefficient that no residual tells of."""
    return float(np.hypot(DOUBT_SHARE * coefficient_px, DOUBT_FLOOR_PX))
