"""Labels of a cloud carried over to other points of the same surface, and to triangles."""

from __future__ import annotations

import numpy as np

from semsfm_colmap.types import Float, Int

NUM_VOTERS = 3
"""Nearest points that vote, the nearer the more."""


def nearest_labels(points: Float, label: Int, at: Float) -> Int:
    """The label that the nearest labelled points of a surface have at other points: (K,).

    Each of the `NUM_VOTERS` nearest votes with the inverse of its distance.

    Parameters
    ----------
    points : (N, 3), N >= 1
    label : (N,) small integers
    at : (K, 3)

    """
    from scipy.spatial import cKDTree

    at = np.asarray(at)
    out = np.zeros(len(at), dtype=np.int64)
    usable = np.isfinite(at).all(axis=1)
    if not usable.any():
        return out
    k = min(NUM_VOTERS, len(points))
    distance, idx = cKDTree(points).query(at[usable], k=k, workers=-1)
    votes = np.asarray(label)[np.reshape(idx, (-1, k))]
    weight = 1.0 / np.maximum(np.reshape(distance, (-1, k)), 1e-12)
    numbers = np.unique(label)
    score = np.stack([(weight * (votes == number)).sum(axis=1) for number in numbers], axis=1)
    out[usable] = numbers[score.argmax(axis=1)]
    return out


def face_labels(vertex_label: Int, faces: Int) -> Int:
    """The label that two or three corners of a triangle share, else that of the first: (F,).

    Examples
    --------
    >>> face_labels(np.array([1, 1, 2, 3]), np.array([[0, 1, 2], [2, 1, 0], [3, 2, 0]])).tolist()
    [1, 1, 3]

    """
    a, b, c = np.asarray(vertex_label)[faces.reshape(-1, 3)].T
    return np.where(b == c, b, a)
