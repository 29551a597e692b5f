"""What else shading may do to features than drag, and what it does when a specimen is mounted anew.

An observation of a point with the outward unit normal n in the camera's frame is seen at

    xy = q + c f(n) + sum_k g_k h_k(n),

f the drag (`drag`), h_k the nine fields of `shading_fields`. In one series the g_k look so much
like rotations that seeking them brings the cameras no nearer to the truth, and they are a part of
the error bars alone. Several series of one specimen show it turned in the image plane, so that the
same point is displaced in another direction of the specimen's: then the g_k are determined, and
left out they turn the series against each other. With ``g_k ~ N(0, SHADING_SIGMA_PX^2)`` they are
parameters that all images share, like c.

What a polynomial of the normal does not hold is another in each series. Its size is that of fields
f and h_k of each series' own, SERIES_SIGMA_PX each: a part of the error bars again.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from scipy import sparse

from semsfm_colmap.geometry.eliminated import Displacing
from semsfm_colmap.refinement.adjustment import PoseModel
from semsfm_colmap.refinement.drag import drag_field
from semsfm_colmap.types import Float, Int, OrthographicCameras

P = TypeVar("P")

SHADING_SIGMA_PX = 0.15
"""Standard deviation of each other field of the normal by which shading may displace features."""
SERIES_SIGMA_PX = 0.3
"""The same of the drag and of each other field of one of several series: the angles between the two
series of fourteen rendered pairs (docs/merge.md) then have pulls of RMS 1."""
ODD_FIELDS = slice(6, 9)
"""Those that change sign with the image directions of the normal, as the drag does."""
NUM_FIELDS = 9


def shading_fields(cam_from_world: Float, normals: Float, image_idx: Int, track_idx: Int) -> Float:
    """What else shading may do than drag: fields (O, 2, 9) of the normal, of size 1.

    A pull toward a detector on one side, (1, 0) and (0, 1) times n_c^2, and all fields linear or
    quadratic in the normal that tell x from y or turn; what a rotation, a shift or the drag itself
    explains is not among them.
    """
    n = np.einsum("oij,oj->oi", cam_from_world[image_idx], normals[track_idx])
    x, y, z = n[:, 0], n[:, 1], np.maximum(-n[:, 2], 0.0)
    o = np.zeros_like(x)
    fields = [
        (z * z, o),
        (o, z * z),
        (x * x - y * y, o),
        (o, x * x - y * y),
        (2 * x * y, o),
        (o, 2 * x * y),
        (z * x, -z * y),
        (z * y, z * x),
        (z * y, -z * x),
    ]
    return np.stack([np.stack(field, axis=1) for field in fields], axis=2)


def reversed_coefficients(coefficients_px: Float) -> Float:
    """The coefficients (9,) of the depth-reversed model, whose normals point the other way."""
    out = np.array(coefficients_px)
    out[ODD_FIELDS] *= -1.0
    return out


def fields_of_series(
    cam_from_world: Float, normals: Float, image_idx: Int, track_idx: Int, series_idx: Int
) -> Float:
    """Drag and `shading_fields` of each series by itself: (O, 2, 10 S) for S series.

    Parameters
    ----------
    series_idx : (M,) of each image

    """
    drag = drag_field(cam_from_world, normals, image_idx, track_idx)[:, :, None]
    other = shading_fields(cam_from_world, normals, image_idx, track_idx)
    fields = np.concatenate([drag, other], axis=2)
    own = series_idx[image_idx, None] == np.unique(series_idx)
    return np.asarray(np.einsum("odk,os->odsk", fields, own).reshape(len(fields), 2, -1))


@dataclass(frozen=True, kw_only=True, eq=False)
class ShadingModel(Generic[P]):
    """`CameraModel` of another one's parameters and the coefficients g of the fields.

    Its parameters are the pair. As for the drag, cameras and normals of the fields are held.
    """

    base: PoseModel[P]
    cam_from_world: Float
    """(M, 3, 3) for the fields only"""
    normals: Float
    """(N, 3)"""

    @property
    def param_idx(self) -> Int:
        """The base's parameters, then the coefficients, which all images share."""
        base = self.base.param_idx
        own = self.base.num_params + np.arange(NUM_FIELDS, dtype=np.int64)
        return np.concatenate([base, np.tile(own, (len(base), 1))], axis=1)

    @property
    def num_params(self) -> int:
        """Nine more than the base has."""
        return self.base.num_params + NUM_FIELDS

    def poses(self, params: tuple[P, Float]) -> OrthographicCameras:
        """The cameras of the base."""
        return self.base.poses(params[0])

    def cameras(self, params: tuple[P, Float]) -> tuple[Float, Float]:
        """The base's; what shading adds is no affine camera, see `displacement`."""
        return self.base.cameras(params[0])

    def displacement(self, params: tuple[P, Float], image_idx: Int, track_idx: Int) -> Float:
        """(O, 2) px: what is added to the image of an affine camera, the base's with it."""
        shown = self.fields(image_idx, track_idx) @ params[1]
        if isinstance(self.base, Displacing):
            shown = shown + self.base.displacement(params[0], image_idx, track_idx)
        return np.asarray(shown)

    def fields(self, image_idx: Int, track_idx: Int) -> Float:
        """The module's h: (O, 2, 9)."""
        return shading_fields(self.cam_from_world, self.normals, image_idx, track_idx)

    def jacobian(self, params: tuple[P, Float], X: Float, image_idx: Int, track_idx: Int) -> Float:
        """That of the base, and the fields."""
        base = self.base.jacobian(params[0], X, image_idx, track_idx)
        return np.concatenate([base, self.fields(image_idx, track_idx)], axis=2)

    def retract(self, params: tuple[P, Float], step: Float) -> tuple[P, Float]:
        """The base's step; those of the coefficients are added."""
        return self.base.retract(params[0], step[:-NUM_FIELDS]), params[1] + step[-NUM_FIELDS:]

    def prior(self, params: tuple[P, Float]) -> tuple[Float, sparse.csr_array]:
        """The base's, and coefficients near zero."""
        r, J = self.base.prior(params[0])
        own = sparse.eye_array(NUM_FIELDS, format="csr") / SHADING_SIGMA_PX
        return (
            np.append(r, params[1] / SHADING_SIGMA_PX),
            sparse.csr_array(sparse.block_diag([J, own])),
        )
