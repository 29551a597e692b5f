"""Plain, slow references of the surface stage's fast routines."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from scipy.ndimage import map_coordinates

from semsfm_colmap.types import Array, Float, Int


def correlation_cost(
    reference: Array,
    base: Array,
    views: Array,
    B: Float,
    c: Float,
    e: Float,
    offset: float,
    radius: int,
    noise: Float,
    side: Int,
    max_cost: int,
) -> Float:
    """Cost of one surface ``base + offset``, pixel by pixel: (H, W), nan near the border."""
    H, W = reference.shape
    y, x = np.mgrid[0:H, 0:W] + 0.5
    total, count = np.zeros((2, H, W)), np.zeros((2, H, W))
    out = np.full((H, W), np.nan)
    for j, view in enumerate(views):
        z = base + offset
        u = B[j, 0, 0] * x + B[j, 0, 1] * y + c[j, 0] * z + e[j, 0] - 0.5
        v = B[j, 1, 0] * x + B[j, 1, 1] * y + c[j, 1] * z + e[j, 1] - 0.5
        inside = (u >= 0) & (v >= 0) & (u <= view.shape[1] - 1.01) & (v <= view.shape[0] - 1.01)
        warped = map_coordinates(view.astype(float), [v, u], order=1, mode="nearest")
        for row in range(radius, H - radius):
            for column in range(radius, W - radius):
                window = np.s_[
                    row - radius : row + radius + 1, column - radius : column + radius + 1
                ]
                a, b = reference[window].astype(float), warped[window]
                covariance = ((a - a.mean()) * (b - b.mean())).mean()
                ncc = covariance / np.sqrt(
                    (a.var() + noise[0] ** 2) * (b.var() + noise[1 + j] ** 2)
                )
                total[side[j], row, column] += ncc * inside[row, column]
                count[side[j], row, column] += inside[row, column]
    best = (total / (count + 1e-6)).max(axis=0)
    inner = np.s_[radius : H - radius, radius : W - radius]
    out[inner] = max_cost * (1.0 - np.clip(best, 0.0, 1.0))[inner]
    return out


def surface_step(
    reference: Array,
    lit: Array,
    surface: Array,
    views: Array,
    slopes: Array,
    c: Float,
    window: Int,
    noise: float,
    grey_cut: float,
    spread: float,
    row: int,
    column: int,
) -> tuple[float, float, float]:
    """Depth, correlation and information of one pixel after a step, with B = 1 and e = 0."""
    x, y = window[:, 0] + column, window[:, 1] + row
    z = surface[y, x].astype(float)
    tukey = np.maximum(1.0 - ((reference[y, x] - reference[row, column]) / grey_cut) ** 2, 0.0) ** 2
    w = np.where(np.isfinite(z), tukey, 0.0)
    w /= w.sum()
    z = np.nan_to_num(z)
    terms = []
    for j in range(len(views)):
        at = [y + c[j, 1] * z, x + c[j, 0] * z]
        b, g = (
            map_coordinates(image[j].astype(float), at, order=1, mode="nearest")
            for image in (views, slopes)
        )
        a = lit[j, y, x].astype(float)
        a, b, g = a - w @ a, b - w @ b, g - w @ g
        a /= np.sqrt(w @ a**2 + noise**2)
        norm = np.sqrt(w @ b**2 + noise**2)
        b, g = b / norm, g / norm
        g = g - b * (w @ (b * g))
        terms.append([w @ (a * b), w @ (g * (a - b)), w @ g**2])
    correlation, numerator, denominator = np.array(terms).T
    weight = np.maximum(1.0 - (max(correlation.max(), 0.0) - correlation) / spread, 0.0)
    mean = weight @ correlation / weight.sum()
    step = weight @ numerator / (weight @ denominator)
    limit = 0.5 / np.linalg.norm(c, axis=1).max()
    information = weight @ denominator * 0.5 * len(window) / max(2.0 * (1.0 - mean), 0.02)
    moved = surface[row, column] + np.clip(step, -limit, limit)
    return float(moved), float(mean), float(information)


def surface_jump(base: Array, here: tuple[int, int], there: tuple[int, int], step: float) -> int:
    """Labels by which a base surface is higher here than its slopes let expect from there."""
    y, x = here
    yb, xb = there
    p = 0.5 * (float(base[1, y, x]) + float(base[1, yb, xb]))
    q = 0.5 * (float(base[2, y, x]) + float(base[2, yb, xb]))
    rise = p * (x - xb) + q * (y - yb)
    return round((float(base[0, y, x]) - float(base[0, yb, xb]) - rise) / step)


def semi_global_sum(
    cost: Array, grey: Array, base: Array, step: float, p1: int, p2: int, grey_step: float
) -> Int:
    """Hirschmueller's recursion over a base surface, one path after the other: (H, W, D)."""
    H, W, D = cost.shape
    total = np.zeros((H, W, D), dtype=np.int64)
    for dy, dx in [(0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)]:
        path = np.zeros((H, W, D), dtype=np.int64)
        rows = range(H) if dy >= 0 else range(H - 1, -1, -1)
        columns = range(W) if dx >= 0 else range(W - 1, -1, -1)
        for y in rows:
            for x in columns:
                yb, xb = y - dy, x - dx
                if not (0 <= yb < H and 0 <= xb < W):
                    path[y, x] = cost[y, x]
                    continue
                change = abs(float(grey[y, x]) - float(grey[yb, xb]))
                jump = max(int(p2 / (1.0 + change / grey_step)), p1 + 1)
                before = path[yb, xb]
                higher = surface_jump(base, (y, x), (yb, xb), step)
                for d in range(D):
                    choices = [before.min() + jump]
                    for k in (-1, 0, 1):
                        if 0 <= d + higher + k < D:
                            choices.append(before[d + higher + k] + p1 * abs(k))
                    path[y, x, d] = int(cost[y, x, d]) + min(choices) - before.min()
        total += path
    return total


def least_triangulation_cost(polygon: Float, sliver_weight: float) -> float:
    """The least cost over all triangulations, by trying every one: for a few corners only."""
    n = len(polygon)
    if n < 3:
        return 0.0
    best = np.inf
    for k in range(1, n - 1):
        corners = polygon[[0, k, n - 1]]
        area = 0.5 * np.linalg.norm(np.cross(corners[1] - corners[0], corners[2] - corners[0]))
        longest2 = max(np.sum((p - q) ** 2) for p, q in combinations(corners, 2))
        parts = least_triangulation_cost(polygon[: k + 1], sliver_weight)
        parts += least_triangulation_cost(polygon[k:], sliver_weight)
        best = min(best, float(area + sliver_weight * longest2) + parts)
    return best


def boundary_edges(faces: Int) -> set[tuple[int, int]]:
    """Undirected edges that only one face has."""
    seen: dict[tuple[int, int], int] = {}
    for face in faces.tolist():
        for a, b in combinations(sorted(face), 2):
            seen[a, b] = seen.get((a, b), 0) + 1
    return {edge for edge, count in seen.items() if count == 1}


def is_edge_manifold(faces: Int) -> bool:
    """Whether each edge has at most two faces, which agree on their outside."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    return len(np.unique(edges, axis=0)) == len(edges)
