"""How a patch of surface moves from image to image: the plane-induced affine map.

Around a point X with normal n the surface is its tangent plane. A step D in that plane, ``n . D =
0``, is seen as ``A_i D`` in image i; so a patch of image i is mapped into image j by

    W = A_j [A_i; n^T]^-1 [e1 e2]        (2 x 2)

which parallel projection makes the same all over the plane.
"""

from __future__ import annotations

import numpy as np

from semsfm_colmap.types import Float


def plane_induced_warp(A_from: Float, A_to: Float, normal: Float) -> Float:
    """The affine map of a tangent plane from one image into another.

    Parameters
    ----------
    A_from, A_to : (..., 2, 3) linear parts of the projections
    normal : (..., 3), not perpendicular to the viewing direction of `A_from`

    Returns
    -------
    (..., 2, 2); numpy.linalg.LinAlgError where the plane is seen edge on

    """
    stacked = np.concatenate([A_from, normal[..., None, :]], axis=-2)
    return np.asarray(A_to @ np.linalg.inv(stacked)[..., :, :2])
