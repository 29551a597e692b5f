"""The points of a model as a cloud with normals and standard deviations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from semsfm_colmap.surface.fusion.cloud import sparse_cloud
from semsfm_colmap.surface.options import SurfaceOptions
from semsfm_colmap.types import Float, PointCloud, Reconstruction


def oriented_points(reconstruction: Reconstruction) -> PointCloud:
    """The points with normals toward the viewers and standard deviations."""
    covariance = point_covariance(reconstruction)
    stored = reconstruction.point_covariance
    if stored is not None:
        known = np.isfinite(stored).all(axis=(1, 2), keepdims=True)
        covariance = np.where(known, stored, covariance)
    return sparse_cloud(replace(reconstruction, point_covariance=covariance), SurfaceOptions())


def point_covariance(reconstruction: Reconstruction) -> Float:
    """Covariance of each point with the cameras held fixed: (N, 3, 3), world units squared.

    ``C_j = sigma^2 (sum_o A_o^T A_o)^-1`` over the inlier observations of the point, A the linear
    part of its camera, ``sigma^2 = sum r^2 / (2 O - 3 N)`` from the residuals of all of them.
    """
    obs = reconstruction.observations.select(reconstruction.inlier)
    A = reconstruction.cameras.projection[obs.image_idx]
    H = np.zeros((len(reconstruction.points), 3, 3))
    np.add.at(H, obs.track_idx, np.einsum("oki,okj->oij", A, A))
    r = reconstruction.residuals()[reconstruction.inlier]
    freedom = max(2 * len(obs) - 3 * len(reconstruction.points), 1)
    variance = float(np.sum(r**2) / freedom)
    return np.asarray(variance * np.linalg.pinv(H, hermitian=True))
