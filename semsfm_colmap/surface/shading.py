"""Shading of an image series: one law of the normal for all images, and one gain per image.

More secondary electrons leave a surface that is inclined to the beam, and a detector on one side
sees more of those that start toward it. With n the outward unit normal in the camera's frame,
image i sees a place of albedo a as

    grey = a gain_i exp(d . n).

``(d_x, d_y)`` points to the detector's side of the image, and ``d_z`` is how much brighter slopes
are than what faces the viewer (``n_z = -1``). On the smooth normals of a reconstructed mesh the
secant law ``1 / cos`` with its own exponent beside d explains no more.

Where the specimen turns, a place is seen under many normals, so that albedo, d and gains come
apart. The component of n along an axis that all turns share stays the same at a place; what is due
to it is told from albedo by the prior that albedo varies about a common mean without regard to the
normal.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from semsfm_colmap.types import Array, Float

_ALBEDO_PRIOR = 0.3
"""Weight of the albedo's common mean, in frontal images: the variance of one observation of log
grey over that of log albedo, 0.15^2 / 0.27^2 on rendered series. 0.1 and 1 give the same there."""
_GRADIENT_PRIOR = 0.02
"""Weight of d = 0: the variance of one observation of log grey over that of d, 0.15^2 / 1. It
decides where a plane has one normal in each image, which its gain explains as well."""
_MIN_GREY = 1.0
"""Darker greys count as this one: they have no logarithm."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Shading:
    """The module's law, fitted to a series: greys are albedo times `factor`."""

    gradient: Float
    """(3,) d, in the camera's frame"""
    gain: Float
    """(M,) so that the geometric mean of all factors in the images is 1"""

    def factor(self, image_idx: int, normals_cam: Float) -> Float:
        """Grey over albedo in an image: outward unit normals (..., 3) -> (...)."""
        return np.asarray(self.gain[image_idx] * np.exp(normals_cam @ self.gradient))


def fit_shading(grey: Array, weight: Array, normals_cam: Float | None) -> Shading:
    """Fit law and gains to the greys of places that several images see.

    Minimises over d, the gains and the albedos a_v

        sum_iv w_iv (log I_iv - log a_v - log gain_i - d . n_iv)^2 + 0.3 sum_v (log a_v)^2
        + 0.02 |d|^2,

    the mean of the albedos being in the gains, by the normal equations with the albedos eliminated:
    each place has the weight matrix ``diag(w) - w w^T / (sum w + 0.3)``.

    Parameters
    ----------
    grey : (M, V)
    weight : (M, V), 0 where image i does not see place v; an image without any keeps the gain 1
    normals_cam : (M, V, 3) outward unit normals in the frames of the cameras; None: gains only, d=0

    """
    num_images = len(grey)
    used = weight.any(axis=1)
    if not used.any():
        return Shading(gradient=np.zeros(3), gain=np.ones(num_images))
    num = 0 if normals_cam is None else 3
    normals = np.zeros((*grey.shape, 0)) if normals_cam is None else normals_cam
    y = np.log(np.maximum(grey, _MIN_GREY)).astype(np.float64)
    w = weight.astype(np.float64)

    total = w.sum(axis=0) + _ALBEDO_PRIOR
    weighted = w[..., None] * normals
    at_place, y_at_place = weighted.sum(axis=0), (w * y).sum(axis=0)
    left = np.empty((num + num_images, num + num_images))
    left[:num, :num] = np.tensordot(weighted, normals, axes=((0, 1), (0, 1)))
    left[:num, :num] += _GRADIENT_PRIOR * np.eye(num)
    left[:num, :num] -= at_place.T @ (at_place / total[:, None])
    left[num:, :num] = weighted.sum(axis=1) - (w / total) @ at_place
    left[:num, num:] = left[num:, :num].T
    left[num:, num:] = np.diag(w.sum(axis=1)) - (w / total) @ w.T
    right = np.concatenate(
        [
            np.tensordot(weighted, y, axes=((0, 1), (0, 1))) - at_place.T @ (y_at_place / total),
            (w * y).sum(axis=1) - (w / total) @ y_at_place,
        ]
    )
    solution = np.linalg.lstsq(left, right)[0]  # rows of unused images are zero
    gradient, log_gain = solution[:num], solution[num:]
    mean = float(np.average(normals @ gradient + log_gain[:, None], weights=w))
    return Shading(
        gradient=gradient if num else np.zeros(3),
        gain=np.where(used, np.exp(log_gain - mean), 1.0),
    )
