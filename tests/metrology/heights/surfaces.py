"""Surfaces with known parameters, for the tests of the metrology package."""

from __future__ import annotations

import numpy as np

from semsfm_colmap.metrology.heights.filters import gaussian
from semsfm_colmap.metrology.heights.height_map import HeightMap
from semsfm_colmap.types import Float, TriangleMesh


def a_map(z: Float, dx: float = 1.0, dy: float = 1.0, sigma: float | None = None) -> HeightMap:
    spread = None if sigma is None else np.full(z.shape, sigma)
    return HeightMap(z=z, spacing=(dx, dy), unit="um", sigma=spread)


def waves(amplitude: float, length: float, num: int, periods: float, deg: float = 0.0) -> HeightMap:
    """A wave that runs in a direction from x toward y: `num` cells over so many periods along x."""
    dx = periods * length / num
    x, y = np.meshgrid(np.arange(num) * dx, np.arange(num) * dx)
    along = np.cos(np.radians(deg)) * x + np.sin(np.radians(deg)) * y
    return a_map(amplitude * np.cos(2.0 * np.pi * along / length + 0.3), dx, dx)


def rough(
    rows: int, columns: int, length: float, Sq: float, seed: int, holes: float = 0.0
) -> Float:
    """Gaussian heights of a given Sq whose spectrum is that of a Gaussian filter of `length`."""
    rng = np.random.default_rng(seed)
    z = gaussian(rng.normal(size=(rows, columns)), (1.0, 1.0), length, order=0)
    z = (z - z.mean()) * (Sq / z.std())
    if holes:
        z[rng.uniform(size=z.shape) < holes] = np.nan
    return z


def sheet(z: Float, step: float = 1.0, sigma: float | None = None) -> TriangleMesh:
    """A mesh through heights on a grid, counter-clockwise from above."""
    rows, columns = z.shape
    x, y = np.meshgrid(np.arange(columns) * step, np.arange(rows) * step)
    vertices = np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)
    at = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]
    faces = np.concatenate(
        [np.stack([a, b, c], axis=-1).reshape(-1, 3), np.stack([a, c, d], axis=-1).reshape(-1, 3)]
    )
    return TriangleMesh(
        vertices=vertices,
        faces=faces,
        vertex_sigma=None if sigma is None else np.full(len(vertices), sigma),
    )


def sphere(radius: float, num: int = 40) -> TriangleMesh:
    """A closed sphere."""
    theta, phi = np.meshgrid(
        np.linspace(0.0, np.pi, num), np.linspace(0.0, 2.0 * np.pi, 2 * num), indexing="ij"
    )
    unit = np.stack(
        [np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1
    )
    grid = sheet(np.zeros(theta.shape))
    return TriangleMesh(vertices=radius * unit.reshape(-1, 3), faces=grid.faces[:, ::-1])
