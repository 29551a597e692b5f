"""Keypoints and matches of the guided pass in the project's database."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from semsfm_colmap.colmap.database.measured import write_num_measured
from semsfm_colmap.colmap.database.work import replace_appended_keypoints
from semsfm_colmap.geometry.epipolar import estimate_affine_fundamental
from semsfm_colmap.mapping.keypoints import guided_matches
from semsfm_colmap.types import Float

if TYPE_CHECKING:
    from semsfm_colmap.colmap.database.work import DatabaseImage
    from semsfm_colmap.mapping.finish import MappedPart


def write_guided(
    database_path: Path,
    images: Mapping[str, DatabaseImage],
    measured: Mapping[str, Float],
    extended: Mapping[str, Float],
    parts: Sequence[MappedPart],
    min_num_matches: int,
) -> None:
    """Put what the guided pass has added behind what was measured, in one transaction.

    Measured keypoints keep their numbers, descriptors and matches; those of an earlier guided pass
    go. COLMAP sees longer tracks, and the model's points refer to keypoints that are there.
    """
    write_num_measured(
        database_path, {images[name].image_id: len(xy) for name, xy in measured.items()}
    )
    keypoints = {
        images[name].image_id: (len(measured[name]), extended[name][len(measured[name]) :])
        for name in measured
    }
    geometries = {}
    for (first, second), rows in guided_matches(parts, min_num_matches).items():
        a, b = images[first].image_id, images[second].image_id
        xy1, xy2 = extended[first][rows[:, 0]], extended[second][rows[:, 1]]
        if a > b:
            a, b, rows, xy1, xy2 = b, a, rows[:, ::-1], xy2, xy1
        geometries[a, b] = (np.asarray(estimate_affine_fundamental(xy1, xy2)), rows)
    replace_appended_keypoints(database_path, keypoints, geometries)
