r"""The actuator as a goniometer: axis, angle of each image, wobble, path, and what it read.

The axis and the angles are those of `motion.axis`. Errors of the poses are rotation vectors e_i in
the camera frames, ``R_i <- exp([e_i]x) R_i``, with the joint covariance C (3M, 3M). To first order
the angle moves by ``a . e_i``, so the angles have the covariance ``G C G^T``, G = (a^T, ..., a^T);
against their mean, which no gauge moves, it is taken off on both sides.

The axis is where all images put it. With T_a, T_w (3, 2) normal to a and w the fit of `motion.axis`
is, to first order, the least squares solution (p, q) of

    T_a^T (R_i (w + T_w q) - (a + T_a p)) = 0    for all i,

linear in what the images say, ``T_a^T R_i w``. These err by ``T_a^T (e_i x a)``, jointly, and by
the wobble, each by itself; both are carried through. In the world, whose axes are those of the
first image, the axis also errs with that image.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from semsfm_colmap.geometry.losses import MAD_TO_SIGMA
from semsfm_colmap.motion.axis import AxisRotation, fit_axis
from semsfm_colmap.motion.order import is_in_order, order_by_angle
from semsfm_colmap.motion.path import SpecimenPath, specimen_path
from semsfm_colmap.motion.readout import MIN_READOUTS, ReadoutLine, fit_readout, follow_readout
from semsfm_colmap.types import Float, Int, OrthographicCameras


@dataclass(frozen=True, kw_only=True, eq=False)
class Readout:
    """What an actuator or a stage read at M images."""

    value: Float
    """(M,) um or rad; nan where nothing was recorded"""

    @property
    def known(self) -> Int:
        """Numbers (K,) of the images that have one."""
        return np.flatnonzero(np.isfinite(self.value))

    @property
    def differs(self) -> bool:
        """True when enough are known and they are not all one."""
        value = self.value[self.known]
        return len(value) >= MIN_READOUTS and float(np.ptp(value)) > 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Goniometer:
    """The motion of M images, in the order of acquisition, or of rotation where that is lost."""

    images: Int
    """(M,) numbers of the images as they were given, in the order of all that follows"""
    in_order: bool
    """True when the images were given in the order of the rotation"""
    series: AxisRotation
    """signed so that the angle grows with the displacement, or else the tilt, where it is known"""
    angle_sigma_rad: Float | None
    """(M,) against the mean of all"""
    axis_covariance_rad2: Float
    """(2, 2) of the axis in the camera frame: within the image plane, and out of it"""
    axis_world_sigma_rad: float
    """the same in the world"""
    axis_offset_rad: Float
    """(M, 2) where each image puts the axis against the fitted one: in the image plane, from x
    toward y, and out of it, away from the viewer"""
    axis_offset_sigma_rad: Float | None
    """(M, 2) of these"""
    path: SpecimenPath
    displacement: ReadoutLine | None
    """of the images that have one; None where too few have, or they do not differ"""
    tilt: ReadoutLine | None
    """the same of the stage's recorded tilt"""

    @property
    def axis_sigma_rad(self) -> float:
        """Of the axis in the camera frame, in the direction in which it is known worst."""
        return _largest_sigma(self.axis_covariance_rad2)

    @property
    def order(self) -> Int:
        """Numbers (M,) of the images as they were given, by their angles."""
        return self.images[np.argsort(self.series.angle_rad, kind="stable")]


def measure_goniometer(
    cameras: OrthographicCameras,
    centre: Float,
    *,
    displacement: Readout,
    tilt: Readout,
    covariance: Float | None = None,
    stretch: float = 0.0,
) -> Goniometer | None:
    """The motion of a series, as given in the order of acquisition; None where nothing turns.

    Parameters
    ----------
    cameras : of M images
    centre : (3,) of the specimen, in the world
    covariance : (3M, 3M) of the rotation vectors of the images, rad^2
    stretch : relative standard deviation of all angles together, beside `covariance`

    """
    R = np.asarray(cameras.cam_from_world)
    series = fit_axis(R)
    if series is None:
        return None
    images = np.arange(len(R))
    in_order = is_in_order(series)
    if not in_order:
        all_known = displacement.differs and len(displacement.known) == len(R)
        images = np.argsort(displacement.value) if all_known else order_by_angle(series)
        series = fit_axis(R[images])
        assert series is not None
    moved = Readout(value=displacement.value[images])
    tilted = Readout(value=tilt.value[images])
    C = None
    if covariance is not None:
        rows = (3 * images[:, None] + np.arange(3)).reshape(-1)
        C = covariance[np.ix_(rows, rows)]
    line, series = _follow(moved, series, C, stretch)
    angles = _angle_covariance(C, series, stretch)
    stage = _line(tilted, series.angle_rad, angles)
    if line is None and stage is not None and stage.slope < 0.0:
        series = _the_other_way(series)
        stage = _line(tilted, series.angle_rad, angles)
    axis = _axis_errors(R[images], series, C)
    return Goniometer(
        images=images,
        in_order=in_order,
        series=series,
        angle_sigma_rad=None if angles is None else np.sqrt(np.diag(centred(angles))),
        axis_covariance_rad2=axis.camera_rad2,
        axis_world_sigma_rad=axis.world_rad,
        axis_offset_rad=R[images] @ series.axis_world @ image_frame_of_axis(series.axis_camera),
        axis_offset_sigma_rad=None if C is None else axis.offset_rad,
        path=specimen_path(cameras.select(images), centre, series),
        displacement=line,
        tilt=stage,
    )


def centred(covariance: Float) -> Float:
    """The covariance (M, M) of what differs from the mean of all."""
    half = covariance - covariance.mean(axis=0)
    return np.asarray(half - half.mean(axis=1, keepdims=True))


def _angle_covariance(
    covariance: Float | None, series: AxisRotation, stretch: float
) -> Float | None:
    """(M, M) of the angles about the axis."""
    if covariance is None:
        return None
    a, M = series.axis_camera, len(series.angle_rad)
    own = np.einsum("a,iajb,b->ij", a, covariance.reshape(M, 3, M, 3), a)
    together = stretch * (series.angle_rad - series.angle_rad.mean())
    return np.asarray(own + np.outer(together, together))


def _line(readout: Readout, angle_rad: Float, covariance: Float | None) -> ReadoutLine | None:
    """The line of the angles (M,) against a read-out."""
    if not readout.differs:
        return None
    known = readout.known
    C = None if covariance is None else covariance[np.ix_(known, known)]
    return fit_readout(readout.value[known], angle_rad[known], C)


def _follow(
    readout: Readout, series: AxisRotation, covariance: Float | None, stretch: float
) -> tuple[ReadoutLine | None, AxisRotation]:
    """The line against the displacement, which tells the sign of the axis and the whole turns."""
    if not readout.differs:
        return None, series
    known, angle = readout.known, np.array(series.angle_rad)
    angle[known] = follow_readout(angle[known], readout.value[known])
    first = _line(readout, angle, None)
    assert first is not None
    angle[known] = first.angle_rad
    # an image without a read-out stays on the turn of the one before it that has one
    before = np.maximum(np.searchsorted(known, np.arange(len(angle)), side="right") - 1, 0)
    offset = (angle - series.angle_rad)[known[before]]
    angle = np.where(np.isfinite(readout.value), angle, series.angle_rad + offset)
    followed = replace(series, angle_rad=angle - angle[0])
    if first.slope < 0.0:
        followed = _the_other_way(followed)
    C = _angle_covariance(covariance, followed, stretch)
    return _line(readout, followed.angle_rad, C), followed


def _the_other_way(series: AxisRotation) -> AxisRotation:
    """The same motion about the axis of the other sign."""
    return replace(
        series,
        axis_camera=-series.axis_camera,
        axis_world=-series.axis_world,
        angle_rad=-series.angle_rad,
    )


def image_frame_of_axis(axis: Float) -> Float:
    """(3, 2) unit vectors normal to an axis in the camera frame: within the image plane, out of it.

    The first turns the axis from x toward y, the second away from the viewer.
    """
    along = np.array([axis[0], axis[1], 0.0])
    length = float(np.linalg.norm(along))
    along = along / length if length > 1e-9 else np.array([1.0, 0.0, 0.0])
    inside = np.array([-along[1], along[0], 0.0])
    return np.stack([inside, np.cross(axis, inside)], axis=1)


@dataclass(frozen=True, kw_only=True, eq=False)
class _AxisErrors:
    """How the axis errs."""

    camera_rad2: Float
    """(2, 2) covariance in the camera frame, see `image_frame_of_axis`"""
    world_rad: float
    """standard deviation in the frame of the first image, in the direction where it is largest"""
    offset_rad: Float
    """(M, 2) of where each image puts it against the fitted one, by the errors of the poses"""


def _axis_errors(R: Float, series: AxisRotation, covariance: Float | None) -> _AxisErrors:
    """The module's linear fit of the axis, with what it makes of all errors."""
    M, a, w = len(R), series.axis_camera, series.axis_world
    T, T_w = image_frame_of_axis(a), image_frame_of_axis(w)
    turned = T.T @ R @ T_w
    B = np.concatenate([np.tile(-np.eye(2), (M, 1, 1)), turned], axis=2).reshape(2 * M, 4)
    said = ((R @ w - a) @ T).reshape(-1)
    K = np.linalg.pinv(B)
    rest = np.eye(2 * M) - B @ K
    joint = np.zeros((2 * M, 2 * M))
    if covariance is not None:
        # T^T (e x a) = (a x T)^T e, column by column
        E = np.cross(a, T, axisb=0, axisc=0)
        blocks = np.einsum("ap,iajb,bq->ipjq", E, covariance.reshape(M, 3, M, 3), E)
        joint = blocks.reshape(2 * M, 2 * M)
    freedom = max(2 * M - 4, 1)
    scatter = MAD_TO_SIGMA * float(np.median(np.abs(rest @ said))) * math.sqrt(2 * M / freedom)
    left = np.sum((rest @ joint) * rest, axis=1)
    wobble = max(scatter**2 - float(left.sum()) / freedom, 0.0)
    camera, world = K[:2], turned[0] @ K[2:]
    with_first = world - np.eye(2, 2 * M)
    of_world = with_first @ joint @ with_first.T + wobble * world @ world.T
    return _AxisErrors(
        camera_rad2=camera @ joint @ camera.T + wobble * camera @ camera.T,
        world_rad=_largest_sigma(of_world),
        offset_rad=np.sqrt(np.maximum(left, 0.0)).reshape(M, 2),
    )


def _largest_sigma(covariance: Float) -> float:
    """Standard deviation in the direction of the largest."""
    return float(np.sqrt(max(np.linalg.eigvalsh(covariance)[-1], 0.0)))
