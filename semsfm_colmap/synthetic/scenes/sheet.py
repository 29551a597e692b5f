"""A flat sheet that fills the frame at every tilt: what fields and shapes on a plate start from."""

from __future__ import annotations

import numpy as np

from semsfm_colmap.errors import UsageError
from semsfm_colmap.synthetic.primitives import grid_faces
from semsfm_colmap.synthetic.scenes.base import View
from semsfm_colmap.types import Float, Int

MAX_TILT_DEG = 70.0
"""Beyond this the sheet would have to be more than three times as long as the image is high."""


def flat_sheet(view: View, relief: float) -> tuple[Float, Int, tuple[int, int]]:
    """A grid in the plane z = 0 that leaves no gap at the border of any image.

    Parameters
    ----------
    view : edge length and largest tilt
    relief : bound on how far the finished surface stands above or below the plane, scene units

    Returns
    -------
    vertices (nx ny, 3) row by row, faces seen from -z, (nx, ny)

    """
    if view.max_tilt_rad > np.radians(MAX_TILT_DEG):
        raise UsageError(
            f"The field reaches {np.degrees(view.max_tilt_rad):.0f} degrees of tilt but can be"
            f" seen up to {MAX_TILT_DEG:.0f}: choose a smaller range_deg."
        )
    # Any tilt may be about x or y: extend both as far as the foreshortening asks for.
    cosine, sine = np.cos(view.max_tilt_rad), np.sin(view.max_tilt_rad)
    half_x = (view.half_width + relief * sine) / cosine
    half_y = (view.half_height + relief * sine) / cosine
    nx, ny = (int(np.ceil(2.0 * h / view.edge)) + 1 for h in (half_x, half_y))
    x, y = np.linspace(-half_x, half_x, nx), np.linspace(-half_y, half_y, ny)
    vertices = np.stack([*np.meshgrid(x, y, indexing="ij"), np.zeros((nx, ny))], axis=-1)
    # Rows along x, columns along y, seen from -z: reversed to be counter-clockwise.
    return vertices.reshape(-1, 3), grid_faces(nx, ny)[:, ::-1], (nx, ny)
