"""Grey values of the points, from the images that see them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from semsfm_colmap.errors import InputError
from semsfm_colmap.io.grey import read_grey_of_others
from semsfm_colmap.types import Array, Reconstruction


def point_colors(reconstruction: Reconstruction, image_path: Path) -> Array:
    """Mean grey value over the inlier observations of each point: (N, 3) uint8.

    An image that cannot be decoded has no say; a point that none shows is of a middle grey.
    """
    obs = reconstruction.observations.select(reconstruction.inlier)
    total = np.zeros(len(reconstruction.points))
    count = np.zeros(len(reconstruction.points))
    order = np.argsort(obs.image_idx, kind="stable")
    bounds = np.searchsorted(obs.image_idx[order], np.arange(reconstruction.num_images + 1))
    for i, name in enumerate(reconstruction.image_names):
        rows = order[bounds[i] : bounds[i + 1]]
        try:
            grey = read_grey_of_others(image_path / name)
        except InputError:
            continue
        # COLMAP's origin: the centre of the first pixel is (0.5, 0.5)
        column = np.clip(obs.xy[rows, 0].astype(int), 0, grey.shape[1] - 1)
        row = np.clip(obs.xy[rows, 1].astype(int), 0, grey.shape[0] - 1)
        np.add.at(total, obs.track_idx[rows], grey[row, column])
        np.add.at(count, obs.track_idx[rows], 1.0)
    grey_values = np.where(count > 0, total / np.maximum(count, 1.0), 128.0)
    return np.repeat(grey_values[:, None].round().astype(np.uint8), 3, axis=1)
