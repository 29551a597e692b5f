"""Hyperplanes fitted to what lies near them, one at a time and by singular vectors."""

import numpy as np


def optimise_hyperplane(points, normal, offset, thresholds, limit):
    """Normal, offset and score, see `ransac_kernels.optimise_hyperplanes`."""
    for threshold in thresholds:
        near = points[np.abs(points @ normal + offset) < threshold]
        if len(near) < 5:
            break
        mean = near.mean(axis=0)
        normal = np.linalg.svd(near - mean)[2][-1]
        offset = -normal @ mean
    return normal, offset, np.minimum((points @ normal + offset) ** 2, limit).sum()
