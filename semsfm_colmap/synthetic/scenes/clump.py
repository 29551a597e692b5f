"""A clump of spores on the end of a helical ribbon that turns it about its axis, x."""

from __future__ import annotations

import numpy as np

from semsfm_colmap.geometry.mesh_normals import vertex_normals
from semsfm_colmap.geometry.rotations import rotation_from_vector
from semsfm_colmap.synthetic.noise import domes, fractal_noise, scattered_directions
from semsfm_colmap.synthetic.primitives import SPHERE_EDGE, Mesh, geodesic_sphere, merged, sweep
from semsfm_colmap.synthetic.scenes.base import SPECIMEN, SUPPORT, Specimen, View
from semsfm_colmap.types import Float

# fmt: off
SPORE_CENTRES = np.array([
    [-0.75, -0.3, 0.2], [-0.62, 0.36, -0.28], [-0.1, 0.12, 0.45],
    [0.02, -0.42, -0.22], [0.16, 0.45, 0.02], [-0.45, -0.02, -0.42],
])
# fmt: on
SPORE_RADIUS = 0.44
GRANULE_SPACING = 0.062
COIL_RADIUS = 0.33
COIL_PITCH = 0.48
RIBBON_WIDTH = 0.26
RIBBON_THICKNESS = 0.016
COIL_START = 0.1


def build(view: View, rng: np.random.Generator) -> Specimen:
    """Six granular ellipsoids that touch, and the coil from among them to beyond the image."""
    spores = [_spore(centre, view.edge, rng) for centre in SPORE_CENTRES]
    coil = _coil(view, rng)
    vertices, faces = merged([*spores, coil])
    label = np.full(len(vertices), SPECIMEN)
    label[-len(coil[0]) :] = SUPPORT
    texture = fractal_noise(vertices, 22.0, 2, rng, decay=0.8)
    return Specimen(
        vertices=vertices,
        faces=faces,
        texture=texture,
        label=label,
        facts={
            "num_spores": len(spores),
            "coil_radius_units": COIL_RADIUS,
            "coil_pitch_units": COIL_PITCH,
        },
    )


def _spore(centre: Float, edge: float, rng: np.random.Generator) -> Mesh:
    """One ellipsoid covered with granules of many sizes."""
    radius = SPORE_RADIUS * rng.uniform(0.88, 1.08)
    d, faces = geodesic_sphere(max(8, int(np.ceil(SPHERE_EDGE * radius / edge))))
    axes = radius * rng.uniform(0.9, 1.12, 3)
    num = int(4.0 * np.pi * radius**2 / GRANULE_SPACING**2)
    granules = scattered_directions(num, rng, jitter=0.5)
    radii = GRANULE_SPACING / radius * rng.uniform(0.3, 0.78, num)
    height = 0.03 * fractal_noise(d, 1.3, 2, rng)
    height += 0.055 * domes(d, granules, radii)
    height += 0.004 * fractal_noise(d, 30.0, 2, rng)
    turn = rotation_from_vector(rng.normal(size=3))
    wobble = 0.04 * rng.normal(size=3)
    return (d * (1.0 + height)[:, None] * axes) @ turn.T + centre + wobble, faces


def _coil(view: View, rng: np.random.Generator) -> Mesh:
    """A thin strip wound flat on a cylinder about the x axis."""
    end = view.half_width + 1.2
    turns = (end - COIL_START) / COIL_PITCH
    length = turns * np.hypot(2.0 * np.pi * COIL_RADIUS, COIL_PITCH)
    phi = 2.0 * np.pi * turns * np.linspace(0.0, 1.0, max(32, int(length / view.edge)))
    radial = np.stack([np.zeros_like(phi), np.cos(phi), np.sin(phi)], axis=1)
    line = COIL_RADIUS * radial
    line[:, 0] = COIL_START + COIL_PITCH * phi / (2.0 * np.pi)
    tangent = np.gradient(line, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    across = np.cross(tangent, radial)
    num = max(3, int(np.ceil(RIBBON_WIDTH / view.edge)))
    w = RIBBON_WIDTH * np.linspace(-0.5, 0.5, num)
    h = np.full(num, 0.5 * RIBBON_THICKNESS)
    # Around the rectangle: up one face, back down the other.
    u, v = np.concatenate([w, w[::-1]]), np.concatenate([h, -h])
    outline = u[:, None] * across[:, None] + v[:, None] * radial[:, None]
    vertices, faces = sweep(line, outline)
    rough = 0.0015 * fractal_noise(vertices, 14.0, 3, rng)
    return vertices + rough[:, None] * vertex_normals(vertices, faces), faces
