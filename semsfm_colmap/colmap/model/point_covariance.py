"""Covariances of the points of any COLMAP model, its cameras taken as exact.

A point X is seen in image i at ``x_i(X) = pi_i(R_i X + t_i)``, pi_i the camera model with all of
its distortion. With J_i = dx_i / dX and the same noise in every coordinate,

    C = s^2 (sum_i J_i^T J_i)^-1,      s^2 = sum_o |r_o|^2 / (2 O - 3 N),

the sums over the images that see X, over all O observations of N points. C holds how well the point
was found and the angles between its rays; what the cameras err by is not in it.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from semsfm_colmap.colmap.model.any_model import AnyModel
from semsfm_colmap.colmap.model.rows import open_model, rows_of
from semsfm_colmap.types import Float

STEP = 1e-6
"""Of the central differences, as a share of the distance to the camera."""
MIN_INFORMATION = 1e-12
"""Share of the information that is added along every direction: where all rays of a point are one
line, its deviation is large instead of none."""


def point_covariances(model: AnyModel) -> Float:
    """The module's C: (N, 3, 3) world units squared, nan where no observation can be projected.

    Parameters
    ----------
    model : as read from ``model.path``, where its keypoints are

    """
    source = open_model(model.path)
    rows = rows_of(source)
    information = np.zeros((len(model.points), 3, 3))
    squared, num = 0.0, 0
    for i, name in enumerate(model.image_names):
        mine = model.observation_image == i
        point, row = model.observation_point[mine], rows[name]
        R, t = model.cam_from_world[i, :, :3], model.cam_from_world[i, :, 3]
        camera = source.cameras[row.camera_id]
        x = model.points[point] @ R.T + t

        def seen(x: Float, camera: Any = camera) -> Float:
            return np.asarray(camera.img_from_cam(x), dtype=np.float64).reshape(-1, 2)

        off = seen(x) - row.keypoints[model.observation_keypoint[mine]]
        h = STEP * np.linalg.norm(x, axis=1, keepdims=True)
        J = np.stack(
            [(seen(x + h * e) - seen(x - h * e)) / (2.0 * h) for e in np.eye(3)], axis=2
        ) @ R  # fmt: skip
        good = np.isfinite(off).all(axis=1) & np.isfinite(J).all(axis=(1, 2))
        squared += float(np.sum(off[good] ** 2))
        num += int(good.sum())
        np.add.at(information, point[good], np.einsum("nki,nkj->nij", J[good], J[good]))
    known = np.trace(information, axis1=1, axis2=2) > 0
    free = 2 * num - 3 * int(known.sum())
    covariance = np.full_like(information, np.nan)
    if free <= 0:
        return covariance
    trace = np.trace(information[known], axis1=1, axis2=2)[:, None, None]
    inverse = np.linalg.inv(information[known] + MIN_INFORMATION * trace * np.eye(3))
    covariance[known] = squared / free * inverse
    return covariance
