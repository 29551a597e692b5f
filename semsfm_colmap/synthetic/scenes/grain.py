"""A spiny pollen grain of radius 1 on a stalk that leaves the image at the bottom."""

from __future__ import annotations

import numpy as np

from semsfm_colmap.geometry.mesh_normals import vertex_normals
from semsfm_colmap.synthetic.noise import (
    domes,
    fractal_noise,
    scattered_directions,
    smooth_noise,
)
from semsfm_colmap.synthetic.primitives import SPHERE_EDGE, Mesh, geodesic_sphere, merged, tube
from semsfm_colmap.synthetic.scenes.base import SPECIMEN, SUPPORT, Specimen, View
from semsfm_colmap.types import Float

NUM_SPINES = 150
SPINE_LENGTH = 0.2
SPINE_RADIUS = 0.036
NUM_GRANULES = 3600
GRANULE_HEIGHT = 0.016
STALK_RADIUS = 0.32
STALK_DIRECTION = np.array([0.0, 1.0, 0.0])


def build(view: View, rng: np.random.Generator) -> Specimen:
    """Granular body with three furrows, spines on flared feet, and the stalk."""
    spines = scattered_directions(NUM_SPINES, rng, jitter=0.15)
    spines = spines[spines @ STALK_DIRECTION < np.cos(STALK_RADIUS + 0.1)]
    lengths = SPINE_LENGTH * rng.uniform(0.8, 1.15, len(spines))
    body = _body(view.edge, spines, rng)
    needles = [_spine(d, length, view.edge, rng) for d, length in zip(spines, lengths, strict=True)]
    stalk = _stalk(view, rng)
    vertices, faces = merged([body, *needles, stalk])
    label = np.full(len(vertices), SPECIMEN)
    label[-len(stalk[0]) :] = SUPPORT
    texture = fractal_noise(vertices, 22.0, 2, rng, decay=0.8)
    return Specimen(
        vertices=vertices,
        faces=faces,
        texture=texture,
        label=label,
        facts={"num_spines": len(spines), "spine_length_units": SPINE_LENGTH},
    )


def _body(edge: float, spines: Float, rng: np.random.Generator) -> Mesh:
    """The sphere with everything that is a displacement along its radius."""
    d, faces = geodesic_sphere(max(8, int(np.ceil(SPHERE_EDGE / edge))))
    granules = scattered_directions(NUM_GRANULES, rng)
    spacing = np.sqrt(4.0 * np.pi / NUM_GRANULES)
    radii = spacing * rng.uniform(0.4, 0.85, NUM_GRANULES)
    height = 0.018 * fractal_noise(d, 1.6, 2, rng)
    height += GRANULE_HEIGHT * domes(d, granules, radii)
    height += 0.0034 * fractal_noise(d, 40.0, 2, rng, decay=0.7)
    feet = domes(d, spines, np.full(len(spines), 2.6 * SPINE_RADIUS), neighbours=2)
    height += 0.05 * (1.0 - np.sqrt(np.clip(1.0 - feet**2, 0.0, None)))
    # Three furrows along meridians about a tilted pole, fading toward it.
    pole = np.array([0.35, -0.8, 0.5])
    pole /= np.linalg.norm(pole)
    e1 = np.cross(pole, [0.0, 0.0, 1.0])
    e1 /= np.linalg.norm(e1)
    longitude = np.arctan2(d @ np.cross(pole, e1), d @ e1) + 0.12 * smooth_noise(d, 4.0, rng)
    latitude = np.arcsin(np.clip(d @ pole, -1.0, 1.0))
    off = np.abs((longitude * 3.0 / (2.0 * np.pi) + 0.5) % 1.0 - 0.5) * 2.0 * np.pi / 3.0
    width = 0.022 * np.cos(latitude) + 1e-3
    fade = np.clip(np.cos(1.35 * latitude), 0.0, None)
    height -= 0.06 * fade * np.exp(-0.5 * (off * np.cos(latitude) / width) ** 2)
    return d * (1.0 + height)[:, None], faces


def _spine(direction: Float, length: float, edge: float, rng: np.random.Generator) -> Mesh:
    """A slightly bent, rough needle with a concave flank, its base below the surface."""
    rows = max(6, int(np.ceil(length / edge)))
    around = max(8, int(np.ceil(2.0 * np.pi * SPINE_RADIUS * 0.7 / edge)))
    s = np.linspace(0.0, 1.0, rows)
    bend = np.cross(direction, rng.normal(size=3))
    bend *= 0.18 * length / np.linalg.norm(bend)
    line = (0.985 + s * length)[:, None] * direction + (s**2)[:, None] * bend
    profile = 0.8 * (1.0 - s) ** 1.5 + 0.2 * np.sqrt(np.clip(1.0 - s, 0.0, None))
    radii = SPINE_RADIUS * rng.uniform(0.85, 1.15) * np.maximum(profile, 0.02)
    vertices, faces = tube(line, radii, around)
    rough = 0.0022 * fractal_noise(vertices, 40.0, 2, rng)
    rough[-1] = 0.0
    return vertices + rough[:, None] * vertex_normals(vertices, faces), faces


def _stalk(view: View, rng: np.random.Generator) -> Mesh:
    """A rough column from inside the grain to below the image."""
    end = view.half_height + 0.3
    rows = max(4, int(np.ceil((end - 0.6) / view.edge)))
    y = np.linspace(0.6, end, rows)
    line = np.stack([0.02 * np.sin(2.5 * y), y, 0.02 * np.cos(2.0 * y)], axis=1)
    radii = STALK_RADIUS * (0.93 + 0.05 * y)
    around = max(12, int(np.ceil(2.0 * np.pi * STALK_RADIUS / view.edge)))
    vertices, faces = tube(line, radii, around)
    rough = 0.008 * fractal_noise(vertices * [1.0, 0.4, 1.0], 9.0, 3, rng)
    rough += 0.003 * fractal_noise(vertices, 40.0, 2, rng)
    return vertices + rough[:, None] * vertex_normals(vertices, faces), faces
