"""How the errors of a surface hang together: what a mean over many vertices is worth.

The `sigma` of a vertex (docs/surface_sigma.md) is nearly all relief that the matching windows
average away, so that many vertices together are not more certain by the root of their number. Along
its outward normal the error of vertex k is taken as

    e_k = u + v(n_k) + eps_k,    var u = sigma_u^2,
    cov(v(n), v(m)) = sigma_v^2 exp(-kappa (1 - n . m)),
    cov(eps_k, eps_l) = s_k s_l rho(d_kl),    rho(d) = (1 - f) exp(-d / l) + f exp(-d / L).

- eps is independent only beyond a window: l is 5 px. On synth_nickel, synth_pollen and synth_spore
  the correlation of the errors at 2, 5, 9 and 15 px is 0.6 to 0.8, 0.3 to 0.5, 0.1 to 0.2 and 0. On
  smooth shapes, which a mean over a plane or a ball is taken of, 0.02 to 0.03 of the variance is
  left from 20 to 35 px: f = 0.04 of that about a fit, L = 30 px.
- u is common to the whole surface: windows show ridges, which are bright, rather than grooves, and
  the surface stands out by it. It is in proportion to the relief that the windows smooth away,
  which is what the surest vertices are uncertain by: with q the tenth percentile of the sigmas,
  sigma_u = 0.35 q, the root mean square over the 21 series of docs/surface_sigma.md. Its sign is
  mostly outward, but nothing of it is taken off: on smooth surfaces there is none.
- v is common to all that faces the same way: slopes show another mixture of views and shading. On
  those three series and a cap the mean errors of faces of different slope and azimuth differ by
  0.04 to 0.14 q (root mean square): sigma_v = 0.12 q. kappa = 4: faces at 30, 60 and 90 degrees
  to one another share 0.59, 0.14 and 0.02 of it.
- ``s_k^2 = sigma_k^2 - sigma_u^2 - sigma_v^2``: together they are what the vertex is uncertain by.
  Where a feature is fitted, the scatter of the vertices about it tells s for this very surface.

A value f with ``df = sum_k a_k e_k``, a_k its gradient along the normals, then has the variance

    sigma_u^2 (sum a)^2 + sigma_v^2 sum_kl a_k a_l exp(-kappa (1 - n_k . n_l))
    + sum_kl a_k a_l s_k s_l rho(d_kl).

The radius of a sphere takes u in full; the height of a step, whose planes face the same way,
neither u nor v. The second sum is made from moments of the normals, for

    exp(kappa n . m) = sum_abc kappa^(a+b+c) / (a! b! c!) (n_x m_x)^a (n_y m_y)^b (n_z m_z)^c.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from semsfm_colmap.types import Array, Float

WINDOW_PX = 5.0
"""l"""
COMMON_SHARE = 0.35
"""sigma_u / q"""
FACING_SHARE = 0.12
"""sigma_v / q"""
FACING_CONCENTRATION = 4.0
"""kappa"""
FACING_DEGREE = 16
"""Of the moments: what is left of the series is below 1e-5 of sigma_v^2."""
SUREST = 0.1
REACH = 4.0
"""Vertices more than so many l apart share nothing: exp(-4) = 0.02."""
SLOW_SHARE = 0.04
"""f"""
SLOW_WINDOWS = 6.0
"""L in units of l: 30 px."""
SLOW_CELL = 2.0
"""Cells of the slow part in units of l."""
SLOW_BATCH = 1_000
BATCH = 5_000
"""Vertices whose neighbours are held at a time."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SurfaceError:
    """The module's sigma_u, sigma_v and l, in world units."""

    common: float
    facing: float
    window: float

    def own(self, sigma: Array) -> Float:
        """The module's s of vertices with these sigmas."""
        return np.sqrt(np.maximum(np.square(sigma) - self.common**2 - self.facing**2, 0.0))

    def common_sigma(self, along: Float) -> float:
        """Standard deviation of a value by u, from its gradient along the normals (K,)."""
        return self.common * abs(float(along.sum()))

    def facing_sigma(self, normals: Float, along: Float) -> float:
        """Standard deviation of a value by v: unit normals (K, 3), gradient along them (K,)."""
        kappa = FACING_CONCENTRATION
        degree = np.arange(FACING_DEGREE + 1)
        weight = np.cumprod(np.concatenate([[1.0], kappa / degree[1:]]))  # kappa^a / a!
        x, y, z = (normals[:, k : k + 1] ** degree for k in range(3))
        variance = 0.0
        for a in degree:
            for b in degree[: FACING_DEGREE + 1 - a]:
                c = degree[: FACING_DEGREE + 1 - a - b]
                moment = (along * x[:, a] * y[:, b]) @ z[:, c]
                variance += float(weight[a] * weight[b] * (weight[c] @ moment**2))
        return self.facing * float(np.sqrt(np.exp(-kappa) * variance))

    def window_sigma(self, points: Float, along: Float, own: Float) -> float:
        """Standard deviation of a value by eps: points (K, 3), gradient (K,), the s (K,)."""
        a = along * own
        near, slow = self._within_windows(points, a), self._slow(points, a)
        return float(np.sqrt(max((1.0 - SLOW_SHARE) * near + SLOW_SHARE * slow, 0.0)))

    def _within_windows(self, points: Float, a: Float) -> float:
        """``sum_kl a_k a_l exp(-d / l)`` over neighbours."""
        from scipy.spatial import cKDTree

        tree = cKDTree(points)
        total = 0.0
        for some in range(0, len(points), BATCH):
            near = cKDTree(points[some : some + BATCH]).sparse_distance_matrix(
                tree, REACH * self.window, output_type="ndarray"
            )
            share = np.exp(-near["v"] / self.window)
            total += float(np.sum(a[some + near["i"]] * a[near["j"]] * share))
        return total

    def _slow(self, points: Float, a: Float) -> float:
        """``sum_kl a_k a_l exp(-d / L)``, of many places over cells in which it hardly changes."""
        if len(points) <= SLOW_BATCH:
            apart = np.linalg.norm(points[:, None] - points[None], axis=2)
            return float(a @ np.exp(-apart / (SLOW_WINDOWS * self.window)) @ a)
        cell = np.floor((points - points.min(axis=0)) / (SLOW_CELL * self.window)).astype(np.int64)
        _, number = np.unique(cell, axis=0, return_inverse=True)
        number = number.reshape(-1)
        count = np.bincount(number)
        middle = np.stack([np.bincount(number, points[:, k]) / count for k in range(3)], axis=1)
        sums = np.bincount(number, a)
        total = 0.0
        for some in range(0, len(middle), SLOW_BATCH):
            batch = slice(some, some + SLOW_BATCH)
            apart = np.linalg.norm(middle[batch, None] - middle[None], axis=2)
            total += float(sums[batch] @ np.exp(-apart / (SLOW_WINDOWS * self.window)) @ sums)
        return total


def surface_error(vertex_sigma: Array, px: float) -> SurfaceError:
    """The error of a surface from the sigmas of all of its vertices.

    Parameters
    ----------
    vertex_sigma : (V,) world units
    px : world units of one px of the images

    """
    surest = float(np.quantile(vertex_sigma, SUREST)) if len(vertex_sigma) else 0.0
    return SurfaceError(
        common=COMMON_SHARE * surest, facing=FACING_SHARE * surest, window=WINDOW_PX * px
    )
