"""Moments of the gradient images of the patch (Van Gool, Moons, Ungureanu, ECCV 1996)."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from semsfm_colmap.features.descriptors.filters import standardized
from semsfm_colmap.types import Array, Float


@lru_cache(maxsize=4)
def _monomials(size: int) -> Float:
    """``x^p y^q`` on the disk inside the patch, p + q <= 2: (P - 2, P - 2, 6), mean weight 1."""
    g = ((2.0 * np.arange(size) + 1.0) / size - 1.0)[1:-1]
    x, y = np.broadcast_to(g[None, :], (len(g),) * 2), np.broadcast_to(g[:, None], (len(g),) * 2)
    disk = (x**2 + y**2 <= 1.0).astype(float)
    rows = [disk * x**p * y**q for p, q in ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))]
    return np.asarray(np.stack(rows, axis=-1) / disk.sum())


def moments(patches: Array) -> Array:
    """``M^a_pq = sum x^p y^q (I_d)^a / N`` for d in {x, y}, a in {1, 2}, 0 < p + q <= 2.

    As in Mikolajczyk and Schmid (PAMI 2005), without the moments of order zero: (K, P, P) ->
    (K, 20).
    """
    values = standardized(patches)
    size = patches.shape[1]
    basis = _monomials(size).reshape(-1, 6)[:, 1:].astype(np.float32)
    out = []
    for gradient in (
        values[:, 1:-1, 2:] - values[:, 1:-1, :-2],
        values[:, 2:, 1:-1] - values[:, :-2, 1:-1],
    ):
        flat = (0.25 * size * gradient).reshape(len(patches), (size - 2) ** 2)
        out += [flat @ basis, (flat * flat) @ basis]
    return np.concatenate(out, axis=1).astype(np.float32)
