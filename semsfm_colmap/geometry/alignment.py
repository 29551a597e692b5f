"""Bring two reconstructions into one world: points by a similarity, orthographic cameras likewise.

Throughout, Q is the rotation with ``x_estimated = Q x_true`` (up to scale and shift), so that a
camera that is right has ``R_estimated Q = R_true``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.geometry.rotations import (
    MIRROR_Z,
    depth_reversed,
    nearest_rotation,
    rotation_angle,
)
from semsfm_colmap.types import Float, OrthographicCameras

RANK_TOLERANCE = 1e-9
"""Second singular value of a covariance, relative to the first, below which points are a line."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Similarity:
    """``y = scale * rotation @ x + shift``; `rotation` is orthogonal, det -1 for a reflection."""

    rotation: Float
    scale: float
    shift: Float

    def apply(self, points: Float) -> Float:
        """Transform points (N, 3) -> (N, 3)."""
        return np.asarray(self.scale * (points @ self.rotation.T) + self.shift)

    def apply_to_vectors(self, vectors: Float) -> Float:
        """Rotate directions, e.g. normals, (N, 3) -> (N, 3): neither scaled nor shifted."""
        return np.asarray(vectors @ self.rotation.T)

    @property
    def inverse(self) -> Similarity:
        """The similarity that takes y back to x."""
        return Similarity(
            rotation=self.rotation.T,
            scale=1.0 / self.scale,
            shift=-(self.rotation.T @ self.shift) / self.scale,
        )


def fit_similarity(
    source: Float,
    target: Float,
    *,
    weights: Float | None = None,
    with_scale: bool = True,
    with_reflection: bool = False,
) -> Similarity:
    """Least-squares similarity ``min sum_k w_k ||target_k - (s Q source_k + c)||^2``.

    The covariance of the centred sets is ``C = U S V^T``; then ``Q = U E V^T`` and
    ``s = trace(S E) / var(source)`` with ``E = diag(1, 1, det(U V^T))`` for rotations and the
    identity when a reflection is allowed [Umeyama, PAMI 13(4), 1991, eqs. 39-43].

    Parameters
    ----------
    source, target : (N, 3), N >= 3
    weights : (N,), not negative
    with_scale : False fixes s = 1
    with_reflection : True takes the better of rotation and reflection

    Raises
    ------
    InputError
        The points of a set lie on a line or in one place: no unique rotation.

    Examples
    --------
    >>> source = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 3.0]])
    >>> fit = fit_similarity(source, 2.0 * source + 5.0)
    >>> round(fit.scale, 6), fit.shift.round(6)
    (2.0, array([5., 5., 5.]))
    >>> fit.inverse.apply(np.array([[7.0, 5.0, 5.0]])).round(6) + 0.0
    array([[1., 0., 0.]])

    """
    source = np.asarray(source, dtype=np.float64)
    target = np.asarray(target, dtype=np.float64)
    if source.shape != target.shape or source.ndim != 2 or source.shape[1] != 3:
        raise UsageError(f"{source.shape=}, {target.shape=} but expected both (N, 3)")
    w = np.ones(len(source)) if weights is None else np.asarray(weights, dtype=np.float64)
    if w.shape != (len(source),) or np.any(w < 0):
        raise UsageError(f"{w.shape=} but expected ({len(source)},), none negative")
    if np.count_nonzero(w) < 3:
        raise InputError("A similarity needs at least 3 corresponding points.")
    w = w / w.sum()
    mean_source, mean_target = w @ source, w @ target
    a, b = source - mean_source, target - mean_target
    U, S, Vt = np.linalg.svd((w[:, None] * b).T @ a)
    if S[1] <= RANK_TOLERANCE * max(S[0], np.finfo(float).tiny):
        raise InputError("The corresponding points lie on a line: their rotation is not unique.")
    E = np.ones(3)
    if not with_reflection and np.linalg.det(U @ Vt) < 0:
        E[2] = -1.0
    rotation = (U * E) @ Vt
    scale = float(S @ E / (w @ np.sum(a * a, axis=1))) if with_scale else 1.0
    return Similarity(
        rotation=rotation, scale=scale, shift=mean_target - scale * rotation @ mean_source
    )


def align_rotations(R_est: Float, R_true: Float) -> Float:
    """World rotation Q minimising ``sum_i ||R_est[i] Q - R_true[i]||^2``.

    The minimiser is the rotation nearest to ``sum_i R_est[i]^T R_true[i]``.

    Parameters
    ----------
    R_est, R_true : (M, 3, 3), M >= 1

    Returns
    -------
    (3, 3): ``x_estimated = Q x_true``

    Examples
    --------
    >>> from semsfm_colmap.geometry.rotations import rotation_from_vector
    >>> R_true = rotation_from_vector(np.array([[0.0, 0.0, 0.0], [0.1, 0.5, 0.0]]))
    >>> world = rotation_from_vector(np.array([0.3, 0.2, 0.1]))
    >>> np.allclose(align_rotations(R_true @ world.T, R_true), world)
    True

    """
    if R_est.shape != R_true.shape or R_est.ndim != 3 or len(R_est) == 0:
        raise UsageError(f"{R_est.shape=}, {R_true.shape=} but expected both (M, 3, 3), M >= 1")
    return nearest_rotation(np.einsum("mji,mjk->ik", R_est, R_true))


def depth_reversed_cameras(cameras: OrthographicCameras) -> OrthographicCameras:
    """The twin ``D R D`` that sees points ``D X`` where the cameras saw X, D = diag(1, 1, -1)."""
    return replace(cameras, cam_from_world=depth_reversed(cameras.cam_from_world))


@dataclass(frozen=True, kw_only=True, eq=False)
class CameraAlignment:
    """Estimated cameras in the world of the true ones."""

    true_from_estimated: Similarity
    """Takes estimated points to the true world; a reflection for the depth-reversed hand."""
    depth_reversed: bool
    """Whether the estimate was mirrored before it was aligned."""
    rotation_error_rad: Float
    """(M,) angle between the aligned and the true rotation of each camera"""
    translation_error_px: Float
    """(M, 2) image of the true world's origin: estimated minus true"""
    scale_ratio: Float
    """(M,) estimated over true scale, divided by their geometric mean"""

    @property
    def rotation_rms_rad(self) -> float:
        """Root mean square of the rotation errors."""
        return float(np.sqrt(np.mean(self.rotation_error_rad**2)))


def align_cameras(
    estimated: OrthographicCameras,
    true: OrthographicCameras,
    *,
    reverse_depth: bool = False,
) -> CameraAlignment:
    """Align orthographic cameras with the true ones of the same images, camera by camera.

    With ``X_true = k Q^T X_est + c``, Q is that of `align_rotations` and k the geometric mean of
    the ratios s_est / s_true. The shift takes the true world's origin, triangulated by the
    estimated cameras where the true ones see it,

        min over o of  sum_i ||s_est K2 R_est[:2] o + t_est - t_true||^2,     c = -k Q^T o,

    so it does not depend on where the estimate has its own origin. A shift along the viewing
    direction leaves no trace in one image: o is what all cameras say together; if all look along
    one line, its component along it is 0.

    Parameters
    ----------
    estimated, true : M >= 1 cameras each, in the same order
    reverse_depth : align the depth-reversed twin of `estimated` instead

    Examples
    --------
    The same cameras in a world that is turned and twice as large:

    >>> from semsfm_colmap.geometry.rotations import rotation_from_vector
    >>> R = rotation_from_vector(np.array([[0.0, 0.0, 0.0], [0.0, 0.2, 0.0], [0.0, 0.4, 0.1]]))
    >>> true = OrthographicCameras(
    ...     cam_from_world=R, scale_px_per_unit=np.ones(3), translation_px=np.full((3, 2), 50.0)
    ... )
    >>> world = rotation_from_vector(np.array([0.3, 0.2, 0.1]))
    >>> estimated = replace(true, cam_from_world=R @ world, scale_px_per_unit=np.full(3, 0.5))
    >>> alignment = align_cameras(estimated, true)
    >>> round(alignment.true_from_estimated.scale, 6)
    0.5
    >>> bool(alignment.rotation_rms_rad < 1e-7)
    True
    >>> bool(align_cameras(estimated, true, reverse_depth=True).rotation_rms_rad > 0.1)
    True

    """
    if len(estimated) != len(true) or len(true) == 0:
        raise UsageError(f"{len(estimated)=}, {len(true)=} but expected the same number, >= 1")
    hand = depth_reversed_cameras(estimated) if reverse_depth else estimated
    Q = align_rotations(hand.cam_from_world, true.cam_from_world)
    log_ratio = np.log(estimated.scale_px_per_unit / true.scale_px_per_unit)
    k = float(np.exp(np.mean(log_ratio)))
    rows = hand.projection.reshape(-1, 3)
    wanted = (true.translation_px - estimated.translation_px).reshape(-1)
    origin = np.asarray(np.linalg.lstsq(rows, wanted, rcond=1e-6)[0], dtype=np.float64)
    world = Q.T @ MIRROR_Z if reverse_depth else Q.T
    error = np.asarray(hand.cam_from_world @ Q @ np.swapaxes(true.cam_from_world, 1, 2))
    return CameraAlignment(
        true_from_estimated=Similarity(rotation=world, scale=k, shift=-k * (Q.T @ origin)),
        depth_reversed=reverse_depth,
        rotation_error_rad=rotation_angle(error),
        translation_error_px=(rows @ origin - wanted).reshape(-1, 2),
        scale_ratio=np.exp(log_ratio - np.mean(log_ratio)),
    )


def align_cameras_both_hands(
    estimated: OrthographicCameras, true: OrthographicCameras
) -> tuple[CameraAlignment, CameraAlignment]:
    """The alignments of the cameras as given and of their depth-reversed twin."""
    return (
        align_cameras(estimated, true),
        align_cameras(estimated, true, reverse_depth=True),
    )
