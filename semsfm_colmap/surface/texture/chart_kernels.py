"""Compiled kernels of the charts: labels that neighbours agree on, and faces that would overlap."""

from __future__ import annotations

import math

import numba
import numpy as np

from semsfm_colmap.types import Array


@numba.njit(nogil=True, cache=True)
def smooth_labels(
    cosine: Array, neighbor: Array, agreement: float, min_cosine: float, max_rounds: int
) -> Array:
    """The direction of each face under a Potts model, by iterated conditional modes (Besag 1986).

    Each face in turn takes the label l that maximises ``cosine_fl + agreement * (number of
    neighbours with l)`` among those with ``cosine_fl >= min_cosine``, until none changes.

    Parameters
    ----------
    cosine : (F, L) between the normal of a face and each direction; in every row one is at least
        `min_cosine`
    neighbor : (F, 3) faces, -1 for none

    Returns
    -------
    (F,) int64

    """
    num_faces, num_labels = cosine.shape
    label = np.empty(num_faces, dtype=np.int64)
    for f in range(num_faces):
        label[f] = np.argmax(cosine[f])
    for _ in range(max_rounds):
        changed = False
        for f in range(num_faces):
            best, best_score = label[f], -np.inf
            for k in range(num_labels):
                if cosine[f, k] < min_cosine:
                    continue
                score = cosine[f, k]
                for g in neighbor[f]:
                    if g >= 0 and label[g] == k:
                        score += agreement
                if score > best_score:
                    best, best_score = k, score
            changed |= best != label[f]
            label[f] = best
        if not changed:
            break
    return label


@numba.njit(nogil=True, cache=True)
def overlapping(uv: Array, order: Array, start: Array) -> Array:
    """Faces that cover the centre of a texel which an earlier face of their chart covers.

    Parameters
    ----------
    uv : (F, 3, 2) float64, in texels
    order : (F,) faces, chart by chart
    start : (C + 1,) where each chart begins in `order`

    Returns
    -------
    (F,) bool

    """
    found = np.zeros(len(uv), dtype=np.bool_)
    for c in range(len(start) - 1):
        faces = order[start[c] : start[c + 1]]
        x0, y0 = np.inf, np.inf
        x1, y1 = -np.inf, -np.inf
        for f in faces:
            for k in range(3):
                x0, x1 = min(x0, uv[f, k, 0]), max(x1, uv[f, k, 0])
                y0, y1 = min(y0, uv[f, k, 1]), max(y1, uv[f, k, 1])
        column, row = math.floor(x0), math.floor(y0)
        taken = np.zeros((math.ceil(y1) - row + 1, math.ceil(x1) - column + 1), dtype=np.bool_)
        for f in faces:
            ax, ay = uv[f, 0, 0] - column, uv[f, 0, 1] - row
            bx, by = uv[f, 1, 0] - column - ax, uv[f, 1, 1] - row - ay
            cx, cy = uv[f, 2, 0] - column - ax, uv[f, 2, 1] - row - ay
            det = bx * cy - by * cx
            if det == 0.0:
                continue
            left = math.floor(ax + min(0.0, bx, cx))
            right = math.ceil(ax + max(0.0, bx, cx))
            top = math.floor(ay + min(0.0, by, cy))
            bottom = math.ceil(ay + max(0.0, by, cy))
            for paint in range(2):  # look first, then paint: a face does not overlap itself
                if paint == 1 and found[f]:
                    break
                for y in range(top, bottom):
                    for x in range(left, right):
                        px, py = x + 0.5 - ax, y + 0.5 - ay
                        b1 = (px * cy - py * cx) / det
                        b2 = (bx * py - by * px) / det
                        # strictly inside: neighbours share their edge
                        if b1 > 1e-9 and b2 > 1e-9 and b1 + b2 < 1.0 - 1e-9:
                            if paint == 1:
                                taken[y, x] = True
                            elif taken[y, x]:
                                found[f] = True
    return found
