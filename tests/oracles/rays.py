"""Which points a surface hides: one ray against every triangle, no tree."""

import numpy as np


def is_hidden(point, to_viewer, vertices, faces, lift):
    """Whether any triangle lies between a point and a viewer infinitely far away.

    Moller and Trumbore (1997), the determinants written out for all triangles at once.
    """
    s = point + lift * to_viewer - vertices[faces[:, 0]]
    ab = vertices[faces[:, 1]] - vertices[faces[:, 0]]
    ac = vertices[faces[:, 2]] - vertices[faces[:, 0]]
    p, q = np.cross(to_viewer, ac), np.cross(s, ab)
    det = np.sum(ab * p, axis=1)
    det[np.abs(det) < 1e-15] = np.nan  # parallel
    u, v, distance = np.sum(s * p, axis=1) / det, q @ to_viewer / det, np.sum(ac * q, axis=1) / det
    return bool(np.any((u >= 0) & (v >= 0) & (u + v <= 1) & (distance > 0)))
