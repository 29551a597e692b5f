r"""Two labels on a neighbourhood graph: a random walker with priors.

Each point has a prior p of being of the part, from what it looks like, and shares its label with
its neighbours as far as their normals agree. The probabilities minimise

    sum_ij w_ij (x_i - x_j)^2 + sum_i g_i (x_i - p_i)^2,
    w_ij = mu max(0, n_i . n_j)^2 exp(-(d_ij / 2 h)^2).

[Grady, Random walks for image segmentation, IEEE PAMI 28(11), 2006, and with priors CVPR 2005],
a sparse symmetric positive definite system: x_i is the probability that a walker from i, absorbed
with rate g, ends at a point of the part. Creases, where normals turn, and gaps are where labels may
change; the two sides of a thin ribbon, whose normals are opposite, do not see one another.
"""

from __future__ import annotations

import numpy as np

from semsfm_colmap.geometry.normals import nearest_neighbors
from semsfm_colmap.types import Float

SEED_RATE = 1e3
"""Absorption at points whose label is given."""
MIN_WEIGHT = 1e-4
"""Keeps every point attached to some other."""
TOLERANCE = 1e-6
MAX_ITERATIONS = 2000


def walk(
    points: Float,
    normals: Float,
    prior: Float,
    rate: Float,
    *,
    smoothness: float,
    num_neighbors: int,
) -> Float:
    """Probability of each point to be of the part, (N,) in 0 to 1.

    Parameters
    ----------
    points, normals : (N, 3), normals of unit length
    prior : (N,) 0 to 1
    rate : (N,) positive: trust in the prior; `SEED_RATE` for given labels
    smoothness : mu
    num_neighbors : edges from each point

    """
    from scipy.sparse import coo_array, diags_array
    from scipy.sparse.linalg import cg

    distance, idx = nearest_neighbors(points, num_neighbors)
    h = np.median(distance[:, -1]) + 1e-300
    agree = np.maximum(np.einsum("nki,ni->nk", normals[idx], normals), 0.0) ** 2
    weight = smoothness * np.maximum(agree * np.exp(-((distance / (2.0 * h)) ** 2)), MIN_WEIGHT)
    row = np.repeat(np.arange(len(points)), idx.shape[1])
    graph = coo_array((weight.ravel(), (row, idx.ravel())), shape=(len(points),) * 2).tocsr()
    graph = 0.5 * (graph + graph.T)
    degree = np.asarray(graph.sum(axis=1)).ravel()
    diagonal = degree + rate
    system = (diags_array(diagonal) - graph).tocsr()
    x, _ = cg(
        system,
        rate * prior,
        x0=prior,
        rtol=TOLERANCE,
        maxiter=MAX_ITERATIONS,
        M=diags_array(1.0 / diagonal),
    )
    return np.clip(x, 0.0, 1.0)
