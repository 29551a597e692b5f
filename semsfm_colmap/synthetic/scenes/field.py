"""A rough electroplated field that fills the frame at every tilt: nodules upon nodules."""

from __future__ import annotations

import numpy as np

from semsfm_colmap.errors import UsageError
from semsfm_colmap.geometry.mesh_normals import vertex_normals
from semsfm_colmap.synthetic.noise import domes, fractal_noise
from semsfm_colmap.synthetic.primitives import grid_faces
from semsfm_colmap.synthetic.scenes.base import SPECIMEN, Specimen, View
from semsfm_colmap.types import Float

MAX_TILT_DEG = 70.0
"""Beyond this the field would have to be more than three times as long as the image is high."""
RELIEF = 0.6
"""Bound on the height of the field above and below its mean plane."""
NODULES = ((0.55, 0.42, 0.55), (0.19, 0.30, 0.75), (0.075, 0.27, 0.8))
"""Per generation: spacing, radius / spacing at least, height / radius; coarse to fine."""


def build(view: View, rng: np.random.Generator) -> Specimen:
    """Three generations of nodules, each growing along the normals of the one before."""
    if view.max_tilt_rad > np.radians(MAX_TILT_DEG):
        raise UsageError(
            f"The field reaches {np.degrees(view.max_tilt_rad):.0f} degrees of tilt but can be"
            f" seen up to {MAX_TILT_DEG:.0f}: choose a smaller range_deg."
        )
    # Any tilt may be about x or y: extend both as far as the foreshortening asks for.
    cosine, sine = np.cos(view.max_tilt_rad), np.sin(view.max_tilt_rad)
    half_x = (view.half_width + RELIEF * sine) / cosine
    half_y = (view.half_height + RELIEF * sine) / cosine
    nx, ny = (int(np.ceil(2.0 * h / view.edge)) + 1 for h in (half_x, half_y))
    x, y = np.linspace(-half_x, half_x, nx), np.linspace(-half_y, half_y, ny)
    vertices = np.stack([*np.meshgrid(x, y, indexing="ij"), np.zeros((nx, ny))], axis=-1)
    vertices = vertices.reshape(-1, 3)
    # Rows along x, columns along y, seen from -z: reversed to be counter-clockwise.
    faces = grid_faces(nx, ny)[:, ::-1]
    vertices[:, 2] -= 0.12 * fractal_noise(vertices, 0.5, 2, rng)
    for spacing, smallest, height in NODULES:
        normal = vertex_normals(vertices, faces)
        centres = _scattered_on(vertices.reshape(nx, ny, 3), spacing, rng)
        radii = spacing * rng.uniform(smallest, 2.4 * smallest, len(centres))
        growth = domes(vertices, centres, radii, neighbours=4)
        vertices += (height * radii.mean() * growth)[:, None] * normal
    normal = vertex_normals(vertices, faces)
    vertices += (0.0035 * fractal_noise(vertices, 22.0, 3, rng, decay=0.7))[:, None] * normal
    vertices[:, 2] -= vertices[:, 2].mean()
    return Specimen(
        vertices=vertices,
        faces=faces,
        texture=fractal_noise(vertices, 18.0, 2, rng, decay=0.8),
        label=np.full(len(vertices), SPECIMEN),
        facts={"nodule_spacing_units": [spacing for spacing, _, _ in NODULES]},
    )


def _scattered_on(sheet: Float, spacing: float, rng: np.random.Generator) -> Float:
    """About one point per `spacing`^2, at random on a sheet of vertices (nx, ny, 3)."""
    nx, ny = sheet.shape[:2]
    extent = np.ptp(sheet[..., :2], axis=(0, 1))
    num = max(4, int(np.ceil(np.prod(extent / spacing))))
    where = rng.uniform(size=(num, 2))
    i, j = (where * [nx - 1, ny - 1]).astype(np.int64).T
    return np.asarray(sheet[i, j])
