"""Shapes whose sizes are known in closed form, on a plate: a sphere cap, a step, a pyramid, a rod.

Each is a height h(x, y) >= 0 above the plate z = 0, toward the viewer (z = -h), with the same fine
relief about it as the field has: mean zero along the normal, so that sizes are those of the mean
surface. Material is that of the other scenes. Sizes are drawn with the specimen, but for the step,
and stand among the specimen's facts in scene units and degrees.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from semsfm_colmap.geometry.mesh_normals import vertex_normals
from semsfm_colmap.synthetic.noise import fractal_noise
from semsfm_colmap.synthetic.scenes.base import SPECIMEN, Specimen, View
from semsfm_colmap.synthetic.scenes.sheet import flat_sheet
from semsfm_colmap.types import Float

MAX_HEIGHT = 0.85
"""No shape is higher, scene units."""
STEP_HEIGHT = 0.8
"""2 um where a scene unit is 2.5 um."""
STEP_HALF_WIDTH = 0.45
"""Of its top."""
STEP_SLOPE_DEG = 65.0
FINE_RELIEF = 0.0035
"""Standard deviation of the relief about the shape."""

Shape = tuple[Callable[[Float, Float], Float], dict[str, float]]
"""h(x, y), and its sizes"""


def build_cap(view: View, rng: np.random.Generator) -> Specimen:
    """A cap of a sphere: radius, contact angle a, height ``R (1 - cos a)``, volume above the plate.

    The volume is ``pi h^2 (3 R - h) / 3``.
    """
    radius, contact = rng.uniform(0.9, 1.05), np.radians(rng.uniform(55.0, 65.0))
    sink = radius * np.cos(contact)
    height = radius - sink

    def h(x: Float, y: Float) -> Float:
        return np.asarray(np.sqrt(np.clip(radius**2 - x * x - y * y, 0.0, None)) - sink)

    sizes = {
        "radius_units": radius,
        "height_units": height,
        "contact_deg": float(np.degrees(contact)),
        "volume_units3": np.pi * height**2 * (3.0 * radius - height) / 3.0,
    }
    return on_plate((h, sizes), view, rng)


def build_step(view: View, rng: np.random.Generator) -> Specimen:
    """A flat ridge along y between sloping walls, a step of type A1 of ISO 5436-1."""
    slope = np.tan(np.radians(STEP_SLOPE_DEG))

    def h(x: Float, y: Float) -> Float:
        wall = STEP_HEIGHT - slope * (np.abs(x) - STEP_HALF_WIDTH)
        return np.asarray(np.minimum(wall, STEP_HEIGHT) + 0.0 * y)

    sizes = {
        "height_units": STEP_HEIGHT,
        "half_width_units": STEP_HALF_WIDTH,
        "slope_deg": STEP_SLOPE_DEG,
    }
    return on_plate((h, sizes), view, rng)


def build_pyramid(view: View, rng: np.random.Generator) -> Specimen:
    """A square pyramid: half base b, slope a, height ``b tan a``, volume ``4 b^2 h / 3``."""
    base, slope = rng.uniform(0.8, 0.95), np.radians(rng.uniform(35.0, 41.0))
    height = base * np.tan(slope)

    def h(x: Float, y: Float) -> Float:
        return np.asarray(height - np.tan(slope) * np.maximum(np.abs(x), np.abs(y)))

    sizes = {
        "half_base_units": base,
        "height_units": height,
        "slope_deg": float(np.degrees(slope)),
        "volume_units3": 4.0 * base**2 * height / 3.0,
    }
    return on_plate((h, sizes), view, rng)


def build_cylinder(view: View, rng: np.random.Generator) -> Specimen:
    """A rod along x, sunk into the plate up to the contact angle."""
    radius, contact = rng.uniform(0.75, 0.95), np.radians(rng.uniform(60.0, 68.0))
    sink = radius * np.cos(contact)

    def h(x: Float, y: Float) -> Float:
        return np.asarray(np.sqrt(np.clip(radius**2 - y * y, 0.0, None)) - sink + 0.0 * x)

    sizes = {
        "radius_units": radius,
        "height_units": radius - sink,
        "contact_deg": float(np.degrees(contact)),
    }
    return on_plate((h, sizes), view, rng)


def on_plate(shape: Shape, view: View, rng: np.random.Generator) -> Specimen:
    """The plate with the shape on it, its fine relief and its material."""
    height, sizes = shape
    vertices, faces, _ = flat_sheet(view, MAX_HEIGHT)
    vertices[:, 2] = -np.maximum(height(vertices[:, 0], vertices[:, 1]), 0.0)
    relief = FINE_RELIEF * fractal_noise(vertices, 22.0, 3, rng, decay=0.7)
    vertices = vertices + relief[:, None] * vertex_normals(vertices, faces)
    return Specimen(
        vertices=vertices,
        faces=faces,
        texture=fractal_noise(vertices, 18.0, 2, rng, decay=0.8),
        label=np.full(len(vertices), SPECIMEN),
        facts=sizes,
    )
