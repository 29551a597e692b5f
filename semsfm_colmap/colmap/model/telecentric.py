"""The telecentric pinhole: a perspective camera so far away that it is parallel to a stated bound.

COLMAP has no orthographic camera. A pinhole at distance T_z with focal length f and magnification
``s = f / T_z`` images a point at depth z behind the origin's plane with magnification
``f / (T_z + z) = s / (1 + s z / f)``. Against parallel projection a point moves by

    |x - c| |s z| / (f + s z),

the distance to the principal point times the depth in px over f. All images share f; each image's
magnification is in its T_z and its offset in T_x, T_y.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from semsfm_colmap.types import Float, Int, OrthographicCameras

MIN_FOCAL_FACTOR = 100.0
"""No shorter than so many image widths, however flat the object."""


def depths_px(cameras: OrthographicCameras, points: Float, image_idx: Int) -> Float:
    """Depth of each point along its camera's axis, in px: (O, 3), (O,) -> (O,)."""
    z = np.einsum("oj,oj->o", cameras.viewing_direction[image_idx], points)
    return np.asarray(z * cameras.scale_px_per_unit[image_idx])


def required_focal_length(
    cameras: OrthographicCameras,
    points: Float,
    image_idx: Int,
    principal_point: Float,
    image_size_px: Int,
    max_deviation_px: float,
) -> float:
    """The shortest focal length in px that keeps every observation within the bound.

    Parameters
    ----------
    points, image_idx : (O, 3), (O,), the point and image of each observation
    principal_point : (M, 2)

    """
    xy = cameras.project(points, image_idx)
    offset = np.linalg.norm(xy - principal_point[image_idx], axis=1)
    z = depths_px(cameras, points, image_idx)
    # |d| |z| / (f + z) <= bound
    need = float(np.max(offset * np.abs(z) / max_deviation_px - z, initial=0.0))
    need = max(need, 4.0 * float(np.max(np.abs(z), initial=0.0)))
    need = max(need, MIN_FOCAL_FACTOR * float(np.max(image_size_px)))
    # two significant digits: the same series gives the same camera after small changes
    digits = 10.0 ** (np.floor(np.log10(need)) - 1)
    return float(np.ceil(need / digits) * digits)


def project_pinhole(
    R: Float, T: Float, focal_length_px: float | Float, principal_point: Float, points: Float
) -> Float:
    """COLMAP's pinholes: (O, 3, 3), (O, 3), f or (O, 2), (O, 2), (O, 3) -> (O, 2) px."""
    cam = np.einsum("oij,oj->oi", R, points) + T
    return np.asarray(focal_length_px * cam[:, :2] / cam[:, 2:] + principal_point)


@dataclass(frozen=True, kw_only=True, eq=False)
class PinholeCameras:
    """One pinhole an image: ``xy = focal * x_cam[:2] / x_cam[2] + principal_point``."""

    focal_px: Float
    """(M, 2) along x and y"""
    principal_point_px: Float
    """(M, 2)"""
    cam_from_world: Float
    """(M, 3, 3)"""
    translation: Float
    """(M, 3) world units"""

    def project(self, points: Float, image_idx: Int) -> Float:
        """Project ``points[o]`` into image ``image_idx[o]``: (O, 3), (O,) -> (O, 2) px."""
        return project_pinhole(
            self.cam_from_world[image_idx],
            self.translation[image_idx],
            self.focal_px[image_idx],
            self.principal_point_px[image_idx],
            points,
        )

    @property
    def centers(self) -> Float:
        """(M, 3) where the cameras stand in the world."""
        return np.asarray(-np.einsum("mji,mj->mi", self.cam_from_world, self.translation))


def pinhole_cameras(
    cameras: OrthographicCameras,
    image_size_px: Int,
    focal_length_px: float,
    *,
    equal_distance: bool = False,
) -> PinholeCameras:
    """Pinholes of a focal length, principal point at the image centre.

    Parameters
    ----------
    cameras : their aspect goes into the focal length along y; skew, which a pinhole lacks, is lost
    image_size_px : (M, 2)
    equal_distance : put each image's magnification into its focal length, so that all cameras are
        equally far from the origin, not into its distance. Depth ranges then hold for all images.

    """
    s = np.asarray(cameras.scale_px_per_unit)
    principal = np.asarray(image_size_px) / 2.0
    mean = cameras.mean_scale_px_per_unit
    fx = focal_length_px * s / mean if equal_distance else np.full(len(s), focal_length_px)
    K2_inverse = np.linalg.inv(cameras.K2)
    offset = (cameras.translation_px - principal) @ K2_inverse.T / s[:, None]
    return PinholeCameras(
        focal_px=np.column_stack([fx, fx * cameras.aspect]),
        principal_point_px=principal,
        cam_from_world=cameras.cam_from_world,
        translation=np.column_stack([offset, fx / s]),
    )
