"""What the viewer's budget.js computes, in Python: a value's budget from the page's numbers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from semsfm_colmap.types import Array, Float


def cameras_sigma(
    cameras: Mapping[str, Any],
    arrays: Mapping[str, Array],
    points: Float,
    normals: Float,
    seen: Array,
    gradient: Float,
) -> float:
    """The cameras' part: places (K, 3), which images see them (K, M), gradients (K, 3)."""
    A = np.asarray(arrays["projection"], dtype=np.float64)
    Q = np.asarray(arrays["displacement"], dtype=np.float64)
    exponents = np.array(cameras["exponents"])
    of_normal = exponents[:, 3:].any(axis=1)
    total = np.zeros(Q.shape[3])
    for X, n, sees, g in zip(points, normals, seen > 0, gradient, strict=True):
        H = np.einsum("mxi,mxj->ij", A[sees], A[sees])
        y = np.linalg.solve(H, g)
        at = np.concatenate([(X - cameras["center"]) / cameras["radius"], n])
        basis = np.prod(at**exponents, axis=1)
        for i in np.flatnonzero(sees):
            faces = np.cross(A[i, 0], A[i, 1]) @ n <= 0.0
            shown = np.where(of_normal & ~faces, 0.0, basis)
            total -= np.einsum("x,xbk,b->k", A[i] @ y, Q[i], shown)
    return float(np.linalg.norm(total))


def surface_sigmas(
    surface: Mapping[str, float], points: Float, normals: Float, sigma: Float, gradient: Float
) -> dict[str, float]:
    """The surface's part by cause."""
    along = np.einsum("ki,ki->k", gradient, normals)
    rest = np.square(sigma) - surface["common"] ** 2 - surface["facing"] ** 2
    own = along * np.sqrt(np.maximum(rest, 0.0))
    d = np.linalg.norm(points[:, None] - points[None], axis=2)
    near = np.where(d <= surface["reach"] * surface["window"], np.exp(-d / surface["window"]), 0.0)
    slow = np.exp(-d / surface["slow_window"])
    share = surface["slow_share"]
    alike = np.exp(-surface["concentration"] * (1.0 - normals @ normals.T))
    windows = own @ ((1.0 - share) * near + share * slow) @ own
    return {
        "surface: relief and noise of the windows": float(np.sqrt(max(windows, 0.0))),
        "surface: common offset": surface["common"] * abs(float(along.sum())),
        "surface: offset by where it faces": surface["facing"]
        * float(np.sqrt(max(along @ alike @ along, 0.0))),
    }
