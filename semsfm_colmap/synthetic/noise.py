"""Roughness: smooth random functions of space, scattered points and domes on them."""

from __future__ import annotations

import numpy as np

from semsfm_colmap.types import Float

LATTICE_SIZE = 32
"""Period of the noise in lattice cells; specimens span fewer cells at the coarse scales."""
SPLINE_STD = (151.0 / 315.0) ** 1.5
"""Standard deviation of a cubic B-spline with unit white coefficients in 3-D.

The mean over one cell of the sum of the squared weights is 151/315 along each axis.
"""


def smooth_noise(points: Float, frequency: float, rng: np.random.Generator) -> Float:
    """Random function of space with mean 0, variance 1 and no detail finer than 1 / frequency.

    A cubic B-spline over a periodic lattice of independent normal numbers, at a random offset.

    Parameters
    ----------
    points : (N, 3)
    frequency : lattice cells per unit of length

    Returns
    -------
    (N,)

    """
    from scipy.ndimage import map_coordinates

    lattice = rng.normal(size=(LATTICE_SIZE,) * 3).astype(np.float32)
    where = points * frequency + rng.uniform(0, LATTICE_SIZE, 3)
    value = map_coordinates(lattice, where.T, order=3, mode="grid-wrap", prefilter=False)
    return np.asarray(value / SPLINE_STD, dtype=np.float64)


def fractal_noise(
    points: Float, frequency: float, octaves: int, rng: np.random.Generator, decay: float = 0.5
) -> Float:
    """Sum of `octaves` smooth noises, each twice as fine and `decay` times as high; variance 1."""
    total = np.zeros(len(points))
    power = 0.0
    for octave in range(octaves):
        height = decay**octave
        total += height * smooth_noise(points, frequency * 2.0**octave, rng)
        power += height**2
    return total / np.sqrt(power)


def scattered_directions(num: int, rng: np.random.Generator, jitter: float = 0.35) -> Float:
    """Unit vectors spread evenly but irregularly: a Fibonacci spiral, disturbed.

    Parameters
    ----------
    num : how many
    jitter : standard deviation of the disturbance, in units of the mean spacing

    Returns
    -------
    (num, 3)

    """
    k = np.arange(num) + 0.5
    z = 1.0 - 2.0 * k / num
    longitude = np.pi * (1.0 + np.sqrt(5.0)) * k
    r = np.sqrt(1.0 - z * z)
    v = np.stack([r * np.cos(longitude), r * np.sin(longitude), z], axis=1)
    v = v + jitter * np.sqrt(4.0 * np.pi / num) * rng.normal(size=v.shape)
    return np.asarray(v / np.linalg.norm(v, axis=1, keepdims=True))


def domes(points: Float, centres: Float, radii: Float, neighbours: int = 5) -> Float:
    """Height of the highest spherical dome above each point, in units of that dome's radius.

    ``max_k sqrt(1 - d_k^2 / r_k^2)`` over the nearest centres, 0 where none reaches.

    Parameters
    ----------
    points : (N, 3)
    centres : (K, 3)
    radii : (K,)
    neighbours : how many centres may reach one point

    Returns
    -------
    (N,) in 0..1, times the radius relative to the mean radius

    """
    from scipy.spatial import cKDTree

    neighbours = min(neighbours, len(centres))
    distance, index = cKDTree(centres).query(points, k=neighbours, workers=-1)
    shape = (len(points), neighbours)  # for one neighbour the tree drops an axis
    distance, index = np.reshape(distance, shape), np.reshape(index, shape)
    r = radii[index]
    height = np.sqrt(np.clip(1.0 - (distance / r) ** 2, 0.0, None)) * r / np.mean(radii)
    return np.asarray(height.max(axis=1))
