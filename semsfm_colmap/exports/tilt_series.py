r"""A model as a single-axis tilt series, as electron tomography describes one.

Frame: x right, y up, z toward the viewer, so the camera frame here with y and z reversed,
``D = diag(1, -1, -1)``; positions in an image count from its middle. The axis w in the world is the
unit vector most nearly perpendicular to all viewing directions z_i: it minimises
``sum_i (z_i^T w)^2``. With ``P_i = D R_i`` it is seen in image i as

    P_i w = (-sin r cos b, cos r cos b, sin b):

at the angle r from the vertical, counterclockwise, and out of the image plane by b, which this
choice makes small; r may differ between the views. The tomogram has the axis as its y and the
centroid of the points in its middle: ``X' = s B (X - c)`` px with s the mean magnification. Then
for every view, exactly,

    P_i B^T = R_z(r_i) R_x(b_i) R_y(theta_i),

with right-handed rotations, theta the tilt: ``x = x' cos(theta) + z' sin(theta)``. A single-axis
format drops b_i. Its file has the transformation into the aligned image,
``p = A_i (q - q_i)``, ``A_i = (s / s_i) R_2(-r_i) K^-1``, where q_i is the image of the
tomogram's middle and K the affine intrinsics with y up.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from semsfm_colmap.errors import InputError
from semsfm_colmap.exports.scene import ExportScene
from semsfm_colmap.geometry.rotations import rotation_from_vector
from semsfm_colmap.types import Float, Int

X_AXIS, Y_AXIS, Z_AXIS = np.eye(3)
Y_AND_Z_REVERSED = np.diag([1.0, -1.0, -1.0])
MIN_TILT_RAD = np.radians(0.5)
"""Viewing directions that spread by less (RMS) have no plane, and so no axis."""
MAX_OUT_OF_PLANE_RAD = np.radians(15.0)
"""Viewing directions further from their plane lie on a cone: no single-axis series."""


DEPTH_MARGIN = 1.2
"""Of the tomogram over the extent of the points in depth."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TiltSeries:
    """M views of one size as rotations about one axis, and what that leaves out."""

    size_px: tuple[int, int]
    rotation_rad: Float
    """(M,) r: of the axis from the vertical, counterclockwise"""
    tilt_rad: Float
    """(M,) theta"""
    out_of_plane_rad: Float
    """(M,) b: what a single-axis format drops"""
    magnification: Float
    """(M,) relative to their geometric mean"""
    intrinsics: Float
    """(2, 2) K, y up"""
    middle_px: Float
    """(M, 2) q: image of the tomogram's middle from the middle of the image, y up"""
    image_from_tomogram: Float
    """(M, 2, 3) linear part of the cameras: ``q = q_i + image_from_tomogram X'``, exact"""
    tomogram_px_from_world: Float
    """(3, 4): ``X' = tomogram_px_from_world [X; 1]``, from the tomogram's middle"""
    points_px: Float
    """(N, 3) X', the points in the tomogram"""
    px_per_unit: float
    """mean magnification s"""

    @property
    def tomogram_size_px(self) -> tuple[int, int, int]:
        """Width, height, depth; where the axis lies, aligned images are as high as others wide."""
        width, height = self.size_px
        if abs(np.sin(np.mean(self.rotation_rad))) > np.sqrt(0.5):
            width, height = height, width
        deepest = float(np.abs(self.points_px[:, 2]).max(initial=1.0))
        return width, height, int(np.ceil(2.0 * DEPTH_MARGIN * deepest))

    @property
    def aligning(self) -> Float:
        """(M, 2, 2) A: ``p = A_i (q - q_i)`` has the axis vertical and one magnification."""
        return self.turned_back(self.rotation_rad)

    def turned_back(self, rotation_rad: Float) -> Float:
        """(M, 2, 2) images of one magnification with square pixels, turned back by angles (M,)."""
        rotation = _about(Z_AXIS, -rotation_rad)[:, :2, :2]
        linear = rotation @ np.linalg.inv(self.intrinsics)
        return np.asarray(linear / self.magnification[:, None, None])

    @property
    def single_axis(self) -> Float:
        """(M, 2, 3) like `image_from_tomogram`, with b = 0."""
        tilted = _about(Y_AXIS, self.tilt_rad)[:, :2]
        return np.asarray(np.linalg.inv(self.aligning) @ tilted)

    @property
    def single_axis_rigid(self) -> Float:
        """(M, 2, 3) also with square pixels and one magnification."""
        return np.asarray(
            (_about(Z_AXIS, self.rotation_rad) @ _about(Y_AXIS, self.tilt_rad))[:, :2]
        )

    @property
    def rigid(self) -> Float:
        """(M, 2, 3) the exact rotations with square pixels and one magnification."""
        return np.asarray(self.rotations[:, :2])

    @property
    def rotations(self) -> Float:
        """(M, 3, 3) of the tomogram into each view."""
        out_of_plane = _about(X_AXIS, self.out_of_plane_rad)
        turned = _about(Z_AXIS, self.rotation_rad) @ out_of_plane
        return np.asarray(turned @ _about(Y_AXIS, self.tilt_rad))

    @property
    def euler_zyx_rad(self) -> Float:
        """(M, 3) angles x, y, z of ``P_i B^T = R_z R_y R_x``.

        Of the two solutions the one whose y is near the tilt, so that x stays small beyond 90
        degrees, too.
        """
        Q = self.rotations
        side = np.where(np.cos(self.tilt_rad) < 0.0, -1.0, 1.0)
        x = np.arctan2(side * Q[:, 2, 1], side * Q[:, 2, 2])
        y = np.arctan2(-Q[:, 2, 0], side * np.hypot(Q[:, 0, 0], Q[:, 1, 0]))
        z = np.arctan2(side * Q[:, 1, 0], side * Q[:, 0, 0])
        y += 2.0 * np.pi * np.round((self.tilt_rad - y) / (2.0 * np.pi))
        return np.stack([x, y, z], axis=1)


@dataclass(frozen=True, kw_only=True, eq=False)
class HeldCameras:
    """What a format holds of the cameras: ``q = linear_i X' + middle_i``, and how far that is."""

    linear: Float
    """(M, 2, 3)"""
    middle_px: Float
    """(M, 2) image of the tomogram's middle"""
    loss_px: Float
    """(O,) distance to what the cameras see, over the inlier observations"""


def held_cameras(series: TiltSeries, scene: ExportScene, linear: Float) -> HeldCameras:
    """Cameras with other linear parts (M, 2, 3), shifted to see the points of each view best.

    The shift of a view is the mean over its points of what the linear part changes: the least
    squares one.
    """
    obs = scene.reconstruction.observations.select(scene.reconstruction.inlier)
    gap = np.einsum(
        "oij,oj->oi",
        (series.image_from_tomogram - linear)[obs.image_idx],
        series.points_px[obs.track_idx],
    )
    num_views = len(linear)
    count = np.maximum(np.bincount(obs.image_idx, minlength=num_views), 1)
    sums = [np.bincount(obs.image_idx, gap[:, k], num_views) for k in (0, 1)]
    shift = np.stack(sums, axis=1) / count[:, None]
    return HeldCameras(
        linear=linear,
        middle_px=series.middle_px + shift,
        loss_px=np.linalg.norm(gap - shift[obs.image_idx], axis=1),
    )


def tilt_series(scene: ExportScene) -> TiltSeries:
    """The registered images as a tilt series.

    Tilts are zero where the recorded ones are, in the mean, and have their sense; without recorded
    ones zero is the middle of their range and the axis points up.

    Raises
    ------
    InputError for images of several sizes, and where no axis lies in all image planes

    """
    reconstruction = scene.reconstruction
    sizes = {(int(width), int(height)) for width, height in reconstruction.image_size_px}
    if len(sizes) > 1:
        several = ", ".join(f"{width} x {height}" for width, height in sorted(sizes))
        raise InputError(
            f"the images have several sizes ({several}) but a stack has one: map images of one "
            "size, or cut them to one with --crop"
        )
    cameras = reconstruction.cameras
    P = Y_AND_Z_REVERSED @ cameras.cam_from_world
    w = _axis(P)
    angle = _angles(P, w)[2]
    if _reversed(angle, (P @ w).mean(axis=0), scene.tilt_rad):
        w = -w
    rotation, out_of_plane, angle = _angles(P, w)
    zero = _zero(angle, scene.tilt_rad)
    start = _frame_facing(w, P[0, 2])
    tomogram_from_world = _about(Y_AXIS, np.array(zero)) @ start
    scale = cameras.scale_px_per_unit
    mean_scale = cameras.mean_scale_px_per_unit
    center = reconstruction.points.mean(axis=0)
    to_px = mean_scale * tomogram_from_world
    K = Y_AND_Z_REVERSED[:2, :2] @ cameras.K2 @ Y_AND_Z_REVERSED[:2, :2]
    exact = K @ (P @ tomogram_from_world.T)[:, :2] * (scale / mean_scale)[:, None, None]
    width, height = sizes.pop()
    middle = np.array([width, height]) / 2.0
    seen = cameras.projection @ center + cameras.translation_px - middle
    return TiltSeries(
        size_px=(width, height),
        rotation_rad=rotation,
        tilt_rad=angle - zero,
        out_of_plane_rad=out_of_plane,
        magnification=scale / mean_scale,
        intrinsics=K,
        middle_px=seen * [1.0, -1.0],
        image_from_tomogram=exact,
        tomogram_px_from_world=np.column_stack([to_px, -to_px @ center]),
        points_px=(reconstruction.points - center) @ to_px.T,
        px_per_unit=mean_scale,
    )


def measured_px(series: TiltSeries, scene: ExportScene) -> tuple[Int, Int, Float]:
    """Image, track and position (O, 2) from the image's middle, y up, of the inliers."""
    obs = scene.reconstruction.observations.select(scene.reconstruction.inlier)
    from_middle = (obs.xy - np.array(series.size_px) / 2.0) * [1.0, -1.0]
    return obs.image_idx, obs.track_idx, from_middle


def _about(axis: Float, angle: Float) -> Float:
    """Right-handed rotations: (...) rad -> (..., 3, 3)."""
    return rotation_from_vector(angle[..., None] * axis)


def _frame_facing(w: Float, viewer: Float) -> Float:
    """Rows x, y, z of a right-handed frame with y = w and z as near to the viewer as can be."""
    z = viewer - (viewer @ w) * w
    z /= np.linalg.norm(z)
    return np.stack([np.cross(w, z), w, z])


def _axis(P: Float) -> Float:
    """The unit vector most nearly perpendicular to all viewing directions: (M, 3, 3) -> (3,)."""
    _, spread, axes = np.linalg.svd(P[:, 2] / np.sqrt(len(P)))
    if len(P) < 3 or spread[1] < MIN_TILT_RAD:
        raise InputError("the viewing directions hardly differ, so this is no tilt series")
    w = axes[2]
    furthest = np.degrees(np.max(np.abs(np.arcsin(np.clip(P[:, 2] @ w, -1.0, 1.0)))))
    if np.radians(furthest) > MAX_OUT_OF_PLANE_RAD:
        raise InputError(
            f"the viewing directions leave a plane by up to {furthest:.0f} degrees, so this is no "
            "tilt series about one axis; colmap-text or nfh-sem hold any cameras"
        )
    return np.asarray(w)


def _angles(P: Float, w: Float) -> tuple[Float, Float, Float]:
    """r, b and theta of each view, theta from the first one: 3 x (M,)."""
    in_image = P @ w
    rotation = np.unwrap(np.arctan2(-in_image[:, 0], in_image[:, 1]))
    out_of_plane = np.arcsin(np.clip(in_image[:, 2], -1.0, 1.0))
    upright = _about(Z_AXIS, -rotation) @ P @ _frame_facing(w, P[0, 2]).T
    turned = _about(X_AXIS, -out_of_plane) @ upright
    return rotation, out_of_plane, np.unwrap(np.arctan2(turned[:, 0, 2], turned[:, 0, 0]))


def _reversed(angle: Float, in_image: Float, recorded: Float | None) -> bool:
    """Whether the other sense of the axis gives tilts like the recorded ones, else points up.

    An axis that lies rather than stands points to the right.
    """
    known = np.zeros(len(angle), bool) if recorded is None else np.isfinite(recorded)
    if recorded is not None and known.sum() >= 2 and np.ptp(recorded[known]) > 0:
        return bool(np.polyfit(recorded[known], angle[known], 1)[0] < 0)
    return bool((in_image[1] if abs(in_image[1]) > abs(in_image[0]) else in_image[0]) < 0)


def _zero(angle: Float, recorded: Float | None) -> float:
    """The angle that becomes tilt 0."""
    known = np.zeros(len(angle), bool) if recorded is None else np.isfinite(recorded)
    if recorded is None or not known.any():
        return float(angle.min() + angle.max()) / 2.0
    return float(np.mean(angle[known] - recorded[known]))
