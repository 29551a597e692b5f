"""Compiled reading of patches: pixels of an image under an affine map.

Most of the guided pass is spent here, and it is the processor that limits it, not the memory: of a
pixel of a patch four rows of four are read, which are in the cache, and some 70 operations done.
"""

from __future__ import annotations

import numba
import numpy as np

from semsfm_colmap.types import Array

FREE_ORDER = {"reassoc", "contract", "nsz"}
"""Sums may be taken in any order, which lets them run in vectors; nan and inf stay as they are."""


@numba.njit(nogil=True, cache=True, error_model="numpy", fastmath=FREE_ORDER)
def read_patch(
    image: Array, x: float, y: float, W: Array, radius: int, margin: int, out: Array
) -> bool:
    """Values at ``W p + x`` for the grid p of 2 * radius + 1; False where it leaves the image.

    Cubic (Catmull-Rom) interpolation: with ``f`` the fraction and ``g = 1 - f``, the outer weights
    are ``a = -f g g / 2`` and ``d = -f f g / 2``, the inner ones ``g - 2 a + d``, ``f - 2 d + a``.
    Places are counted from the patch's own corner, where single precision resolves 2e-6 px, and
    pixels by unsigned numbers, which are not looked at for being negative.

    Parameters
    ----------
    image : (H, W) float32
    margin : so many px of the rim of `out` (n, n) are left as they are

    """
    height, width = image.shape
    reach_x = (abs(W[0, 0]) + abs(W[0, 1])) * radius
    reach_y = (abs(W[1, 0]) + abs(W[1, 1])) * radius
    if not (x - reach_x >= 1.0 and y - reach_y >= 1.0):
        return False
    if x + reach_x >= width - 2.0 or y + reach_y >= height - 2.0:
        return False
    # a pixel before the first one that is looked at, so that no fraction is negative by rounding
    left, top = int(x - reach_x) - 1, int(y - reach_y) - 1
    corner_x, corner_y = x - left, y - top
    step_x, step_y = np.float32(W[0, 0]), np.float32(W[1, 0])
    first, above = np.int64(left - 1), np.int64(top - 1)
    one, two, half = np.float32(1.0), np.float32(2.0), np.float32(-0.5)
    i1, i2, i3 = np.uintp(1), np.uintp(2), np.uintp(3)
    for j in range(margin, 2 * radius + 1 - margin):
        py = float(j - radius)
        x0, y0 = np.float32(corner_x + W[0, 1] * py), np.float32(corner_y + W[1, 1] * py)
        for i in range(margin, 2 * radius + 1 - margin):
            px = np.float32(i - radius)
            u, v = x0 + step_x * px, y0 + step_y * px
            iu, iv = np.int32(u), np.int32(v)
            fx, fy = u - np.float32(iu), v - np.float32(iv)
            gx, gy = one - fx, one - fy
            hx, hy = half * fx * gx, half * fy * gy
            ax, dx = hx * gx, hx * fx
            ay, dy = hy * gy, hy * fy
            bx, cx = gx - two * ax + dx, fx - two * dx + ax
            by, cy = gy - two * ay + dy, fy - two * dy + ay
            k0, r0 = np.uintp(first + iu), np.uintp(above + iv)
            k1, k2, k3 = k0 + i1, k0 + i2, k0 + i3
            r1, r2, r3 = r0 + i1, r0 + i2, r0 + i3
            c0 = ay * image[r0, k0] + by * image[r1, k0] + cy * image[r2, k0] + dy * image[r3, k0]
            c1 = ay * image[r0, k1] + by * image[r1, k1] + cy * image[r2, k1] + dy * image[r3, k1]
            c2 = ay * image[r0, k2] + by * image[r1, k2] + cy * image[r2, k2] + dy * image[r3, k2]
            c3 = ay * image[r0, k3] + by * image[r1, k3] + cy * image[r2, k3] + dy * image[r3, k3]
            out[j, i] = ax * c0 + bx * c1 + cx * c2 + dx * c3
    return True


@numba.njit(parallel=True, cache=True, error_model="numpy")
def cut_patches(image: Array, places: Array, radius: int) -> Array:
    """Patches (K, n, n) around pixel indices (K, 2); nan where they leave the image."""
    n = 2 * radius + 1
    out = np.full((len(places), n, n), np.nan, dtype=np.float32)
    for k in numba.prange(len(places)):
        patch = np.empty((n, n), dtype=np.float32)
        if read_patch(image, places[k, 0], places[k, 1], np.eye(2), radius, 0, patch):
            out[k] = patch
    return out
