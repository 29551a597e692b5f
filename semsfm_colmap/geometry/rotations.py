"""Rotations in 3-D: exponential and logarithm, nearest rotation, angles; all vectorised."""

from __future__ import annotations

import numpy as np

from semsfm_colmap.types import Float

MIRROR_Z = np.diag([1.0, 1.0, -1.0])
"""D of the depth reversal: (R, X) and (D R D, D X) have the same orthographic images."""


def skew_matrix(v: Float) -> Float:
    """The matrices [v]_x with ``[v]_x w = v x w``: (..., 3) -> (..., 3, 3)."""
    out = np.zeros((*v.shape[:-1], 3, 3))
    out[..., 0, 1], out[..., 0, 2] = -v[..., 2], v[..., 1]
    out[..., 1, 0], out[..., 1, 2] = v[..., 2], -v[..., 0]
    out[..., 2, 0], out[..., 2, 1] = -v[..., 1], v[..., 0]
    return out


def rotation_from_vector(v: Float) -> Float:
    """Rodrigues' formula ``exp([v]_x)``: (..., 3) rad -> (..., 3, 3).

    Examples
    --------
    A quarter turn about z takes x to y:

    >>> R = rotation_from_vector(np.array([0.0, 0.0, np.pi / 2]))
    >>> (R @ [1.0, 0.0, 0.0]).round(6)
    array([0., 1., 0.])

    """
    v = np.asarray(v, dtype=np.float64)
    theta2 = np.sum(v * v, axis=-1)[..., None, None]
    theta = np.sqrt(theta2)
    small = theta2 < 1e-12
    safe = np.where(small, 1.0, theta)
    a = np.where(small, 1.0 - theta2 / 6.0, np.sin(safe) / safe)
    b = np.where(small, 0.5 - theta2 / 24.0, (1.0 - np.cos(safe)) / safe**2)
    K = skew_matrix(v)
    return np.asarray(np.eye(3) + a * K + b * (K @ K))


def vector_from_rotation(R: Float) -> Float:
    """Rotation vectors, the inverse of `rotation_from_vector`: (..., 3, 3) -> (..., 3) rad.

    Examples
    --------
    >>> v = np.array([[0.1, 0.2, 0.3], [0.0, 2.0, 0.0]])
    >>> np.allclose(vector_from_rotation(rotation_from_vector(v)), v)
    True

    """
    from scipy.spatial.transform import Rotation

    R = np.asarray(R, dtype=np.float64)
    flat = Rotation.from_matrix(R.reshape(-1, 3, 3)).as_rotvec()
    return np.asarray(flat).reshape(*R.shape[:-2], 3)


def nearest_rotation(B: Float) -> Float:
    """The rotation closest to each matrix in the Frobenius norm: (..., 3, 3) -> (..., 3, 3).

    Examples
    --------
    >>> R = rotation_from_vector(np.array([0.1, 0.2, 0.3]))
    >>> np.allclose(nearest_rotation(2.0 * R), R)
    True

    """
    U, _, Vt = np.linalg.svd(B)
    sign = np.where(np.linalg.det(U @ Vt) < 0, -1.0, 1.0)
    U = U.copy()
    U[..., :, 2] *= sign[..., None]
    return np.asarray(U @ Vt)


def wrapped(angle: Float, turn: float = 2.0 * np.pi) -> Float:
    """The same angles in [-turn / 2, turn / 2).

    Examples
    --------
    >>> wrapped(np.array([190.0, -180.0, 180.0]), 360.0)
    array([-170., -180., -180.])

    """
    return np.asarray((angle + 0.5 * turn) % turn - 0.5 * turn)


def rotation_angle(R: Float) -> Float:
    """Angle of each rotation, accurate near 0 and pi: (..., 3, 3) -> (...) rad.

    Examples
    --------
    >>> R = rotation_from_vector(np.array([[3e-8, 4e-8, 0.0], [0.0, 0.0, 3.0]]))
    >>> rotation_angle(R)
    array([5.e-08, 3.e+00])

    """
    R = np.asarray(R)
    sine = 0.5 * np.linalg.norm(
        np.stack(
            [
                R[..., 2, 1] - R[..., 1, 2],
                R[..., 0, 2] - R[..., 2, 0],
                R[..., 1, 0] - R[..., 0, 1],
            ],
            axis=-1,
        ),
        axis=-1,
    )
    cosine = 0.5 * (np.trace(R, axis1=-2, axis2=-1) - 1.0)
    return np.asarray(np.arctan2(sine, cosine))


def depth_reversed(R: Float) -> Float:
    """``D R D``: the rotations of the depth-reversed twin.

    Examples
    --------
    It turns the other way about axes in the image plane, and the same way about the viewing
    direction:

    >>> R = rotation_from_vector(np.array([[0.1, 0.2, 0.3]]))
    >>> vector_from_rotation(depth_reversed(R)).round(6)
    array([[-0.1, -0.2,  0.3]])

    """
    return np.asarray(MIRROR_Z @ R @ MIRROR_Z)
