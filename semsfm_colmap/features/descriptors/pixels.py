"""Descriptors that are the pixels, or their gradients: cross-correlation and PCA-SIFT."""

from __future__ import annotations

import numpy as np

from semsfm_colmap.types import Array

NCC_SIDE = 9
"""Samples a side (Mikolajczyk and Schmid 2005)."""


def ncc(patches: Array) -> Array:
    """Smoothed samples, mean 0 and length 1: (K, 27, 27) -> (K, 81).

    The scalar product of two is their normalised cross-correlation, so the nearest neighbour in
    Euclidean distance is the best correlated patch.
    """
    K, size, _ = patches.shape
    step = size // NCC_SIDE
    cells = patches.reshape(K, NCC_SIDE, step, NCC_SIDE, step).mean(axis=(2, 4))
    values = cells.reshape(K, NCC_SIDE**2)
    values = values - values.mean(axis=1, keepdims=True)
    norm = np.linalg.norm(values, axis=1, keepdims=True)
    return np.asarray(values / np.maximum(norm, 1e-12), dtype=np.float32)


def pca_sift(patches: Array) -> Array:
    """The gradient field itself, length 1 (Ke and Sukthankar, CVPR 2004).

    (K, 41, 41) -> (K, 3042), before the principal components.
    """
    gx = patches[:, 1:-1, 2:] - patches[:, 1:-1, :-2]
    gy = patches[:, 2:, 1:-1] - patches[:, :-2, 1:-1]
    K, inner = len(patches), (patches.shape[1] - 2) ** 2
    values = np.concatenate([gx.reshape(K, inner), gy.reshape(K, inner)], axis=1)
    norm = np.linalg.norm(values, axis=1, keepdims=True)
    return np.asarray(values / np.maximum(norm, 1e-12), dtype=np.float32)
