"""Plain versions of what segmentation does fast."""

from __future__ import annotations

import numpy as np

from semsfm_colmap.types import Bool, Float, Int


def walk(
    points: Float, normals: Float, prior: Float, rate: Float, smoothness: float, k: int
) -> Float:
    """The minimiser of the random walker's energy with a dense matrix."""
    num = len(points)
    gap = np.linalg.norm(points[:, None] - points[None], axis=2)
    order = np.argsort(gap, axis=1)[:, 1 : k + 1]
    h = np.median(np.take_along_axis(gap, order[:, -1:], axis=1))
    weight = np.zeros((num, num))
    for i in range(num):
        for j in order[i]:
            agree = max(float(normals[i] @ normals[j]), 0.0) ** 2
            w = smoothness * max(agree * np.exp(-((gap[i, j] / (2 * h)) ** 2)), 1e-4)
            weight[i, j] += 0.5 * w
            weight[j, i] += 0.5 * w
    system = np.diag(weight.sum(axis=1) + rate) - weight
    return np.asarray(np.linalg.solve(system, rate * prior))


def surface_variation(points: Float, normals: Float, k: int) -> Float:
    """Share of the smallest eigenvalue, point by point."""
    out = []
    for i in range(len(points)):
        gap = np.linalg.norm(points - points[i], axis=1)
        near = [j for j in np.argsort(gap)[1 : k + 1] if normals[j] @ normals[i] > 0]
        values = np.linalg.eigvalsh(np.cov(points[near].T, bias=True))
        out.append(values[0] / values.sum())
    return np.array(out)


def first_points(uv: Float, depth: Float, size: tuple[int, int], cell: float) -> Int:
    """Each cell asks every point."""
    width, height = (int(np.ceil(s / cell)) for s in size)
    out = np.full((height, width), -1)
    at = np.floor(uv / cell).astype(int)
    for y in range(height):
        for x in range(width):
            near = np.flatnonzero((np.abs(at - [x, y]) <= 1).all(axis=1))
            if len(near):
                out[y, x] = near[np.argmin(depth[near])]
    return out


def patches(points: Float, chosen: Bool, reach: float) -> set[frozenset[int]]:
    """Connected patches of the chosen points that are nearer to one another than `reach`."""
    left, found = set(np.flatnonzero(chosen).tolist()), set()
    while left:
        todo, patch = [left.pop()], set()
        while todo:
            i = todo.pop()
            patch.add(i)
            near = [j for j in left if np.linalg.norm(points[i] - points[j]) < reach]
            left.difference_update(near)
            todo += near
        found.add(frozenset(patch))
    return found
