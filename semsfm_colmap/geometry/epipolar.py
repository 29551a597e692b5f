"""Affine epipolar geometry: what parallel projection allows between two images.

Under two affine cameras corresponding points satisfy one linear equation

    n . (x1, y1, x2, y2) + e = 0,   |n| = 1,

so correspondences lie on a hyperplane in 4-space [Hartley and Zisserman 2004, section 14.3].
"""

from __future__ import annotations

import numpy as np

from semsfm_colmap.types import Float


def fundamental_from_hyperplane(n: Float, e: float) -> Float:
    """F with ``[x2, y2, 1] F [x1, y1, 1]^T = n . (x1, y1, x2, y2) + e``: (4,), float -> (3, 3)."""
    a, b, c, d = n
    return np.array([[0.0, 0.0, c], [0.0, 0.0, d], [a, b, e]])


def hyperplane_from_fundamental(F: Float) -> tuple[Float, float]:
    """The inverse of `fundamental_from_hyperplane`, normalised to ``|n| = 1``."""
    n = np.array([F[2, 0], F[2, 1], F[0, 2], F[1, 2]])
    norm = float(np.linalg.norm(n))
    return n / norm, float(F[2, 2] / norm)


def estimate_affine_fundamental(xy1: Float, xy2: Float) -> Float:
    """Fit the affine epipolar constraint to correspondences.

    Minimises the squared distances to a hyperplane in 4-space, whose normal is the smallest right
    singular vector of the centred data [HZ04, algorithm 14.1].

    Parameters
    ----------
    xy1, xy2 : (L, 2) px, L >= 4

    Returns
    -------
    (3, 3), upper-left 2 x 2 block zero, the four linear entries of unit norm

    Examples
    --------
    A specimen turned about y, the vertical of the image, moves along the rows alone:

    >>> X = np.random.default_rng(0).normal(size=(10, 3))
    >>> xy1, xy2 = X[:, :2], np.column_stack([0.9 * X[:, 0] + 0.4 * X[:, 2], X[:, 1]])
    >>> F = estimate_affine_fundamental(xy1, xy2)
    >>> abs(F / F[2, 1]).round(6)
    array([[0., 0., 0.],
           [0., 0., 1.],
           [0., 1., 0.]])

    """
    if len(xy1) < 4 or xy1.shape != xy2.shape:
        raise ValueError(f"{xy1.shape=} and {xy2.shape=} but expected (L, 2) twice with L >= 4")
    data = np.column_stack([xy1, xy2])
    mean = data.mean(axis=0)
    centred = data - mean
    _, vectors = np.linalg.eigh(centred.T @ centred)
    n = vectors[:, 0]
    return fundamental_from_hyperplane(n, -float(n @ mean))


def epipolar_residual(F: Float, xy1: Float, xy2: Float) -> Float:
    """Signed distance to the hyperplane in 4-space: (L,) px.

    For noise of sigma per coordinate in both images it has standard deviation sigma.

    Examples
    --------
    Of a match that is 2 px too low half the square falls on each image:

    >>> F = fundamental_from_hyperplane(np.array([0.0, 1.0, 0.0, -1.0]) / np.sqrt(2.0), 0.0)
    >>> epipolar_residual(F, np.array([[5.0, 7.0]]), np.array([[8.0, 9.0]])).round(4)
    array([-1.4142])

    """
    n, e = hyperplane_from_fundamental(F)
    return np.asarray(np.column_stack([xy1, xy2]) @ n + e)
