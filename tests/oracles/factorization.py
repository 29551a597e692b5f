"""Complete-data factorization [Tomasi and Kanade 1992; paper, equations 3, 8-12].

A measurement matrix without gaps, centred by its row means, has rank three under parallel
projection; its truncated SVD is the best affine reconstruction.
"""

from __future__ import annotations

import numpy as np

from semsfm_colmap.types import AffineModel, Float


def factorize_complete(M: Float) -> AffineModel:
    """The optimal affine reconstruction of a complete measurement matrix.

    Parameters
    ----------
    M : (2 m, n) px, finite; m >= 2, n >= 4

    Returns
    -------
    AffineModel with ``X`` of unit covariance, ``t`` the row means

    """
    mean = M.mean(axis=1)
    U, s, Vt = np.linalg.svd(M - mean[:, None], full_matrices=False)
    root_n = np.sqrt(M.shape[1])
    A = (U[:, :3] * (s[:3] / root_n)).reshape(-1, 2, 3)
    return AffineModel(A=A, t=mean.reshape(-1, 2), X=(Vt[:3] * root_n).T)
