"""Areal parameters and filters by their definitions, cell by cell."""

from __future__ import annotations

import math

import numpy as np

from semsfm_colmap.types import Float


def heights(z: Float) -> dict[str, float]:
    known = [float(v) for row in z for v in row if not math.isnan(v)]
    mean = math.fsum(known) / len(known)
    away = [v - mean for v in known]
    num = len(away)
    Sq = math.sqrt(math.fsum(v * v for v in away) / num)
    return {
        "Sq": Sq,
        "Sa": math.fsum(abs(v) for v in away) / num,
        "Sp": max(away),
        "Sv": -min(away),
        "Sz": max(away) - min(away),
        "Ssk": math.fsum(v**3 for v in away) / num / Sq**3,
        "Sku": math.fsum(v**4 for v in away) / num / Sq**4,
    }


def gradients(z: Float, dx: float, dy: float) -> dict[str, float]:
    """Sdq and Sdr: the slopes of the polynomial of degree 6 through seven neighbours."""
    rows, columns = z.shape
    place = np.arange(-3.0, 4.0)
    slope = np.linalg.inv(np.vander(place, increasing=True))[1]
    square = []
    for r in range(3, rows - 3):
        for c in range(3, columns - 3):
            zx = float(slope @ z[r, c - 3 : c + 4]) / dx
            zy = float(slope @ z[r - 3 : r + 4, c]) / dy
            if not math.isnan(zx + zy):
                square.append(zx * zx + zy * zy)
    return {
        "Sdq": math.sqrt(math.fsum(square) / len(square)),
        "Sdr": 100.0 * math.fsum(math.sqrt(1.0 + s) - 1.0 for s in square) / len(square),
    }


def material(z: Float, fine: int = 200_001) -> dict[str, float]:
    """The Sk family and the volumes from a finely sampled material ratio curve."""
    known = np.sort(z[np.isfinite(z)])[::-1]
    num = len(known)
    p = np.linspace(0.0, 1.0, fine)
    c = np.interp(p * num - 0.5, np.arange(num), known)
    dp = p[1]

    def area(mask: Float, height: float) -> float:
        part = np.where(mask, c - height, 0.0)
        return float(np.sum(part[1:] + part[:-1]) / 2.0 * dp)

    best, first = math.inf, 0
    width = round(0.4 * num)
    for i in range(num - width + 1):
        fall = known[i] - known[i + width - 1]
        if fall < best:
            best, first = fall, i
    q = (np.arange(num) + 0.5) / num
    A = np.stack([np.ones(width), q[first : first + width]], axis=1)
    a, b = np.linalg.lstsq(A, known[first : first + width], rcond=None)[0]
    mr1 = float(p[np.flatnonzero(c >= a)[-1]]) if (c >= a).any() else 0.0
    mr2 = float(p[np.flatnonzero(c >= a + b)[-1]])
    out = {"Sk": -b, "Smr1": 100.0 * mr1, "Smr2": 100.0 * mr2}
    out["Spk"] = 2.0 * area(p <= mr1, a) / mr1
    out["Svk"] = -2.0 * area(p >= mr2, a + b) / (1.0 - mr2)
    at = {s: float(np.interp(s, p, c)) for s in (0.1, 0.8)}
    Vm = {s: area(p <= s, at[s]) for s in at}
    Vv = {s: -area(p >= s, at[s]) for s in at}
    out |= {"Vmp": Vm[0.1], "Vmc": Vm[0.8] - Vm[0.1], "Vvc": Vv[0.1] - Vv[0.8], "Vvv": Vv[0.8]}
    return out


def regression(
    z: Float, weight: Float, dx: float, dy: float, nesting_index: float, order: int
) -> Float:
    """The Gaussian regression filter, a least-squares fit at every cell."""
    alpha = math.sqrt(math.log(2.0) / math.pi)
    rows, columns = z.shape
    out = np.full(z.shape, np.nan)
    y, x = np.meshgrid(np.arange(rows) * dy, np.arange(columns) * dx, indexing="ij")
    for r in range(rows):
        for c in range(columns):
            if not np.isfinite(z[r, c]):
                continue
            u, v = x - x[r, c], y - y[r, c]
            near = (np.abs(u) <= nesting_index) & (np.abs(v) <= nesting_index)
            s = weight * near * np.exp(-math.pi * (u**2 + v**2) / (alpha * nesting_index) ** 2)
            use = np.isfinite(z) & (s > 0)
            terms = [
                u[use] ** i * v[use] ** j for i in range(order + 1) for j in range(order + 1 - i)
            ]
            root = np.sqrt(s[use])
            A = np.stack(terms, axis=1) * root[:, None]
            out[r, c] = np.linalg.lstsq(A, z[use] * root, rcond=None)[0][0]
    return out


def robust_regression(z: Float, dx: float, dy: float, nesting_index: float) -> Float:
    """Second-order fits whose weights follow Tukey's biweight of the residuals, until settled."""
    weight, before = np.isfinite(z).astype(float), math.inf
    while True:
        smooth = regression(z, weight, dx, dy, nesting_index, 2)
        middle = float(np.nanmedian(np.abs(z - smooth)))
        if abs(middle - before) <= 1e-3 * middle:
            return smooth
        before = middle
        share = np.abs(z - smooth) / (4.4478 * middle)
        weight = np.where(share < 1.0, (1.0 - share**2) ** 2, 0.0)


def autocorrelation(z: Float, lag_y: int, lag_x: int) -> float:
    """Correlation of the pairs of measured cells at a lag, about the mean of all."""
    away = z - np.nanmean(z)
    a, b = [], []
    rows, columns = z.shape
    for r in range(rows):
        for c in range(columns):
            if 0 <= r + lag_y < rows and 0 <= c + lag_x < columns:
                one, other = away[r, c], away[r + lag_y, c + lag_x]
                if not math.isnan(one + other):
                    a.append(one)
                    b.append(other)
    return float(np.dot(a, b) / math.sqrt(np.dot(a, a) * np.dot(b, b)))


def topmost(corner: Float, rows: int, columns: int) -> Float:
    """The highest crossing of the vertical line at every node with triangles (F, 3, 3)."""
    out = np.full((rows, columns), np.nan)
    for a, b, c in corner:
        T = np.array([(b - a)[:2], (c - a)[:2]]).T
        if np.linalg.det(T) == 0:
            continue
        for r in range(rows):
            for k in range(columns):
                s, t = np.linalg.solve(T, np.array([k, r]) - a[:2])
                if min(s, t, 1.0 - s - t) >= -1e-9:
                    z = a[2] + s * (b - a)[2] + t * (c - a)[2]
                    out[r, k] = z if np.isnan(out[r, k]) else max(out[r, k], z)
    return out
