"""Light meshes of many kinds of specimen, for simulations that need shape but no fine texture.

Bodies have a radius near 1 and are smaller than the image; fields and substrates lie in the plane
z = 0, their height toward the viewer (-z), and are larger than it. All are drawn at random: what
is true of one specimen must hold for its kind.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from semsfm_colmap.geometry.rotations import rotation_from_vector
from semsfm_colmap.synthetic.noise import domes, fractal_noise, scattered_directions
from semsfm_colmap.synthetic.primitives import Mesh, geodesic_sphere, grid_faces, merged
from semsfm_colmap.types import Float

Shape = Literal["bumpy", "spiny", "clump", "cup", "field", "crater", "substrate"]
SHAPES: tuple[Shape, ...] = ("bumpy", "spiny", "clump", "cup", "field", "crater", "substrate")

SPHERE_SEGMENTS = 28
"""15 680 faces: an edge of 0.04 radii, 15 px on a body of 350 px."""
GRID_EDGE = 0.03


def build_shape(shape: Shape, half_extent: float, rng: np.random.Generator) -> Mesh:
    """Draw a specimen of a kind.

    Parameters
    ----------
    shape : bumpy, spiny (grains), clump (of grains), cup (a hollow body, open to the viewer),
        field (rough, of bumps or of pits), crater (a field with one large hollow or hill),
        substrate (a rough plane with grains lying on it)
    half_extent : half the width and height of fields and substrates

    """
    if shape == "bumpy":
        return grain(rng)
    if shape == "spiny":
        return grain(rng, spines=int(rng.integers(15, 70)))
    if shape == "clump":
        return clump(rng)
    if shape == "cup":
        return cup(rng)
    if shape == "field":
        return field(half_extent, rng)
    if shape == "crater":
        return field(half_extent, rng, large_hollow=float(rng.uniform(-0.9, 0.9)))
    return substrate(half_extent, rng)


def grain(rng: np.random.Generator, spines: int = 0, segments: int = SPHERE_SEGMENTS) -> Mesh:
    """An ellipsoid with roughness, bumps or pits, and spines."""
    d, faces = geodesic_sphere(segments)
    height = rng.uniform(0.01, 0.12) * fractal_noise(d, rng.uniform(0.8, 2.0), 3, rng)
    num = int(rng.integers(20, 300))
    centres = scattered_directions(num, rng)
    radii = np.sqrt(4.0 * np.pi / num) * rng.uniform(0.3, 0.6, num)
    height += rng.uniform(-0.06, 0.1) * domes(d, centres, radii)
    if spines:
        tips = scattered_directions(spines, rng, jitter=0.2)
        foot = domes(d, tips, np.full(spines, rng.uniform(0.1, 0.2)), neighbours=1)
        height += rng.uniform(0.1, 0.35) * foot**3
    axes = rng.uniform(0.75, 1.15, 3)
    return d * (1.0 + height)[:, None] * axes, faces


def clump(rng: np.random.Generator, radius: float = 0.65) -> Mesh:
    """Three to seven grains that touch."""
    num = int(rng.integers(3, 8))
    centres = scattered_directions(num, rng, jitter=0.6) * rng.uniform(0.3, 0.7, (num, 1))
    return merged(
        [
            (radius * rng.uniform(0.5, 0.9) * v + c, f)
            for c, (v, f) in ((c, grain(rng, segments=18)) for c in centres)
        ]
    )


def cup(rng: np.random.Generator) -> Mesh:
    """A hollow hemisphere or a flat dish, its opening toward the viewer, leaning a little."""
    d, faces = geodesic_sphere(SPHERE_SEGMENTS)
    depth = rng.uniform(0.2, 0.9)
    wall = rng.uniform(0.08, 0.2)
    rim = np.sqrt(np.clip(1.0 - d[:, 0] ** 2 - d[:, 1] ** 2, 0.0, None))
    z = np.where(d[:, 2] > 0, (depth + wall) * rim, depth * rim)
    vertices = np.stack([d[:, 0], d[:, 1], z], axis=1)
    vertices *= (1.0 + rng.uniform(0.005, 0.03) * fractal_noise(vertices, 3.0, 3, rng))[:, None]
    vertices[:, 2] -= 0.5 * depth
    return vertices @ rotation_from_vector(0.3 * rng.normal(size=3)).T, faces


def field(half_extent: float, rng: np.random.Generator, large_hollow: float = 0.0) -> Mesh:
    """A rough sheet: noise without a preferred side, and domes or pits of one or two sizes.

    Parameters
    ----------
    half_extent : half its width and height
    large_hollow : depth of a hollow about as wide as the image; negative is a hill

    """
    vertices, faces = _sheet(half_extent)
    up = rng.uniform(0.02, 0.15) * fractal_noise(vertices, rng.uniform(0.5, 1.5), 3, rng)
    side = rng.choice([1.0, -1.0])
    spacing = rng.uniform(0.15, 0.6)
    for _ in range(int(rng.integers(0, 3))):
        num = int((2.0 * half_extent / spacing) ** 2) + 1
        centres = np.zeros((num, 3))
        centres[:, :2] = rng.uniform(-half_extent, half_extent, (num, 2))
        radii = spacing * rng.uniform(0.3, 0.7, num)
        flat = vertices * [1.0, 1.0, 0.0]
        up += side * spacing * rng.uniform(0.1, 0.7) * domes(flat, centres, radii)
        spacing *= 0.45
    if large_hollow:
        width = rng.uniform(0.5, 1.0)
        up -= large_hollow * np.exp(-0.5 * np.sum((vertices / width) ** 2, axis=1))
    vertices[:, 2] = -(up - up.mean())
    return vertices, faces


def substrate(half_extent: float, rng: np.random.Generator) -> Mesh:
    """One to six grains lying on a slightly rough plane."""
    sheet, faces = _sheet(half_extent)
    up = rng.uniform(0.01, 0.04) * fractal_noise(sheet, 2.0, 3, rng)
    sheet[:, 2] = 0.3 - up
    parts: list[Mesh] = [(sheet, faces)]
    for _ in range(int(rng.integers(1, 7))):
        size = rng.uniform(0.2, 0.5)
        v, f = grain(rng, segments=18)
        where = np.array([*rng.uniform(-0.8, 0.8, 2), 0.3 - 0.85 * size])
        parts.append((size * v + where, f))
    return merged(parts)


def _sheet(half_extent: float) -> Mesh:
    n = min(220, int(np.ceil(2.0 * half_extent / GRID_EDGE)))
    line = np.linspace(-half_extent, half_extent, n)
    x, y = np.meshgrid(line, line, indexing="ij")
    vertices: Float = np.stack([x.ravel(), y.ravel(), np.zeros(n * n)], axis=1)
    # rows along x, columns along y, seen from -z: reversed to be counter-clockwise
    return vertices, grid_faces(n, n)[:, ::-1]
