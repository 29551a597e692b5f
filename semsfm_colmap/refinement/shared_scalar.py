"""A camera model with one more number that all images share, and that displaces what they see.

With x(p) the image of a point under a model of parameters p, and a scalar s:

    x(p, s) = x(p) + d(s),   dx/ds = the slope,   s ~ N(0, sigma^2)

The coefficient of the drag of shading (`drag.py`) and kappa, one over the distance of the rays'
common point (`perspective.py`), are such numbers.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from scipy import sparse

from semsfm_colmap.refinement.adjustment import PoseModel
from semsfm_colmap.types import Float, Int, OrthographicCameras

P = TypeVar("P")


@dataclass(frozen=True, kw_only=True, eq=False)
class SharedScalarModel(ABC, Generic[P]):
    """`CameraModel` of another one's parameters and a scalar; its parameters are the pair."""

    base: PoseModel[P]
    sigma: float
    """of the scalar's prior, in its unit"""

    @abstractmethod
    def displacement(self, params: tuple[P, float], image_idx: Int, track_idx: Int) -> Float:
        """(O, 2) px: what is added to the image of an affine camera."""

    @abstractmethod
    def slope(self, params: tuple[P, float], image_idx: Int, track_idx: Int) -> Float:
        """Derivative of the displacement by the scalar: (O, 2)."""

    @property
    def param_idx(self) -> Int:
        """The base's parameters, then the scalar, which all images share."""
        base = self.base.param_idx
        shared = np.full((len(base), 1), self.base.num_params, dtype=np.int64)
        return np.concatenate([base, shared], axis=1)

    @property
    def num_params(self) -> int:
        """One more than the base has."""
        return self.base.num_params + 1

    def poses(self, params: tuple[P, float]) -> OrthographicCameras:
        """The cameras of the base."""
        return self.base.poses(params[0])

    def cameras(self, params: tuple[P, float]) -> tuple[Float, Float]:
        """The base's; what the scalar adds is no affine camera, see `displacement`."""
        return self.base.cameras(params[0])

    def jacobian(self, params: tuple[P, float], X: Float, image_idx: Int, track_idx: Int) -> Float:
        """That of the base, and the slope for the scalar."""
        base = self.base.jacobian(params[0], X, image_idx, track_idx)
        J = np.empty((len(image_idx), 2, base.shape[2] + 1))
        J[:, :, :-1] = base
        J[:, :, -1] = self.slope(params, image_idx, track_idx)
        return J

    def retract(self, params: tuple[P, float], step: Float) -> tuple[P, float]:
        """The base's step; the scalar's is added."""
        return self.base.retract(params[0], step[:-1]), params[1] + float(step[-1])

    def prior(self, params: tuple[P, float]) -> tuple[Float, sparse.csr_array]:
        """The base's, and a scalar near zero."""
        r, J = self.base.prior(params[0])
        own = sparse.csr_array(np.array([[1.0 / self.sigma]]))
        return (
            np.append(r, params[1] / self.sigma),
            sparse.csr_array(sparse.block_diag([J, own])),
        )
