"""Local derivatives at the centre of the patch: steerable filters and differential invariants.

All derivatives to the fourth order are one matrix product with Gaussian derivative filters. The
patch is first brought to mean 0 and deviation 1 under the same window, so gain and offset drop out.
"""

from __future__ import annotations

from functools import lru_cache
from math import factorial

import numpy as np

from semsfm_colmap.types import Array, Float

SIGMA_SHARE = 6.7 / 20.5
"""Deviation of the filters, in half widths of the patch (6.7 of 41 px: Mikolajczyk, Schmid)."""


@lru_cache(maxsize=8)
def derivative_filters(size: int, max_order: int) -> tuple[Float, tuple[tuple[int, int], ...]]:
    """Gaussian derivatives up to an order: (P, P, F) filters, and (order in x, in y) of each.

    Scale-normalised: ``sigma^(m + n) d^m/dx^m d^n/dy^n G``, as Hermite polynomials times G, for
    correlation (not convolution) with a patch.
    """
    g = ((2.0 * np.arange(size) + 1.0) / size - 1.0) / SIGMA_SHARE
    window = np.exp(-0.5 * g**2)
    window /= window.sum()
    hermite = [np.ones_like(g), g]
    for n in range(1, max_order):
        hermite.append(g * hermite[n] - n * hermite[n - 1])
    orders = tuple((order - n, n) for order in range(1, max_order + 1) for n in range(order + 1))
    rows = []
    for m, n in orders:
        kernel = np.outer(hermite[n] * window, hermite[m] * window)
        rows.append(kernel - kernel.mean() if (m + n) % 2 == 0 else kernel)
    return np.stack(rows, axis=-1), orders


@lru_cache(maxsize=8)
def _window(size: int) -> Float:
    g = ((2.0 * np.arange(size) + 1.0) / size - 1.0) / SIGMA_SHARE
    window = np.exp(-0.25 * (g[:, None] ** 2 + g[None, :] ** 2))
    return np.asarray(window / window.sum())


def standardized(patches: Array) -> Array:
    """Patches with mean 0 and deviation 1 under a wide Gaussian window; flat ones become 0."""
    window = _window(patches.shape[1]).astype(np.float32)
    mean = np.einsum("kij,ij->k", patches, window)
    centred = patches - mean[:, None, None]
    variance = np.einsum("kij,kij,ij->k", centred, centred, window, optimize=True)
    return np.asarray(centred / np.sqrt(np.maximum(variance, 1e-12))[:, None, None])


def _derivatives(patches: Array, max_order: int) -> dict[tuple[int, int], Array]:
    filters, orders = derivative_filters(patches.shape[1], max_order)
    size = patches.shape[1]
    flat = standardized(patches).reshape(len(patches), size * size)
    values = flat @ filters.reshape(size * size, len(orders)).astype(np.float32)
    return {order: values[:, n] for n, order in enumerate(orders)}


def steerable(patches: Array) -> Array:
    """Derivatives of order 1 to 4 in the patch's own frame (Freeman and Adelson 1991).

    The frame is turned to the dominant gradient already, which steers the filters: (K, P, P) ->
    (K, 14). Each order is divided by the square root of the factorial that its Hermite polynomial
    carries.
    """
    values = _derivatives(patches, 4)
    columns = [v / np.float32(np.sqrt(factorial(m) * factorial(n))) for (m, n), v in values.items()]
    return np.stack(columns, axis=1).astype(np.float32)


def differential(patches: Array) -> Array:
    """Invariants under rotation of derivatives to the third order: (K, P, P) -> (K, 8).

    The vector of Schmid and Mohr (PAMI 19, 1997, equation 3; Koenderink and van Doorn 1987)
    without the grey value itself. Each is taken to the power of one over its degree, the sign
    kept, so that all are of the dimension of a grey value and Gaussian rather than heavy-tailed.
    """
    d = _derivatives(patches, 3)
    x, y = d[1, 0], d[0, 1]
    xx, xy, yy = d[2, 0], d[1, 1], d[0, 2]
    xxx, xxy, xyy, yyy = d[3, 0], d[2, 1], d[1, 2], d[0, 3]
    invariants = [
        (x * x + y * y, 2),
        (xx * x * x + 2 * xy * x * y + yy * y * y, 3),
        (xx + yy, 1),
        (xx * xx + 2 * xy * xy + yy * yy, 2),
        (
            xxx * y**3 - 3 * xxy * x * y**2 + 3 * xyy * x**2 * y - yyy * x**3,
            4,
        ),
        # L_iij L_j L_k L_k - L_ijk L_i L_j L_k
        (
            (xxx + xyy) * x * (x * x + y * y)
            + (xxy + yyy) * y * (x * x + y * y)
            - (xxx * x**3 + 3 * xxy * x**2 * y + 3 * xyy * x * y**2 + yyy * y**3),
            4,
        ),
        # -eps_ij L_jkl L_i L_k L_l
        (
            -(
                x * (xxy * x * x + 2 * xyy * x * y + yyy * y * y)
                - y * (xxx * x * x + 2 * xxy * x * y + xyy * y * y)
            ),
            4,
        ),
        (xxx * x**3 + 3 * xxy * x**2 * y + 3 * xyy * x * y**2 + yyy * y**3, 4),
    ]
    columns = [np.sign(v) * np.abs(v) ** np.float32(1.0 / degree) for v, degree in invariants]
    return np.stack(columns, axis=1).astype(np.float32)
