"""Plain mutual nearest neighbours: one distance after the other, in double precision."""

from __future__ import annotations

import numpy as np


def match_nearest_plainly(a, b, max_ratio):
    """(L, 2) mutual nearest neighbours that pass the ratio in both directions."""
    distance = np.linalg.norm(a[:, None].astype(float) - b[None].astype(float), axis=2)
    rows = []
    for i in range(len(a)):
        j = int(np.argmin(distance[i]))
        if int(np.argmin(distance[:, j])) != i:
            continue
        along = np.sort(distance[i])
        across = np.sort(distance[:, j])
        if len(along) > 1 and not along[0] < max_ratio * along[1]:
            continue
        if len(across) > 1 and not across[0] < max_ratio * across[1]:
            continue
        rows.append((i, j))
    return np.array(rows, dtype=np.int64).reshape(-1, 2)
