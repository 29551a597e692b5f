"""A rough electroplated field that fills the frame at every tilt: nodules upon nodules."""

from __future__ import annotations

import numpy as np

from semsfm_colmap.geometry.mesh_normals import vertex_normals
from semsfm_colmap.synthetic.noise import domes, fractal_noise
from semsfm_colmap.synthetic.scenes.base import SPECIMEN, Specimen, View
from semsfm_colmap.synthetic.scenes.sheet import flat_sheet
from semsfm_colmap.types import Float

RELIEF = 0.6
"""Bound on the height of the field above and below its mean plane."""
NODULES = ((0.55, 0.42, 0.55), (0.19, 0.30, 0.75), (0.075, 0.27, 0.8))
"""Per generation: spacing, radius / spacing at least, height / radius; coarse to fine."""


def build(view: View, rng: np.random.Generator) -> Specimen:
    """Three generations of nodules, each growing along the normals of the one before."""
    vertices, faces, (nx, ny) = flat_sheet(view, RELIEF)
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
