"""Keypoints that COLMAP finds, as features of ours: of images in a folder, or of database rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from semsfm_colmap.colmap.options import SiftOptions
from semsfm_colmap.io.temporary import temporary_folder
from semsfm_colmap.types import Array, Features, Float

NO_LIMIT = 10**6
VARIANTS: dict[str, dict[str, Any]] = {
    "colmap-sift": {},
    "colmap-sift-affine": {"estimate_affine_shape": True},
    "colmap-sift-pooled": {"domain_size_pooling": True},
}
"""COLMAP's detectors by the names that unions call them, and the options that set them apart."""
BYTE_SCALE = 512.0
"""COLMAP stores descriptor values of length 1 as round(512 v), cut off at 255."""


def sift_features(
    variant: str,
    image_path: Path,
    names: Sequence[str],
    sizes_px: Sequence[tuple[int, int]],
    *,
    max_num_features: int = 0,
    upright: bool = False,
    first_octave: int = SiftOptions.first_octave,
    mask_path: Path | None = None,
    num_threads: int = -1,
) -> list[Features]:
    """Keypoints of some images with COLMAP's own descriptors, through a database for the purpose.

    Parameters
    ----------
    variant : one of `VARIANTS`
    sizes_px : width and height of each
    max_num_features : of an image; 0 sets no limit

    """
    from semsfm_colmap.colmap.database.work import read_descriptors, read_images, read_keypoint_rows
    from semsfm_colmap.colmap.sift import extract_sift

    with temporary_folder() as folder:
        database = Path(folder) / "features.db"
        extract_sift(
            database,
            image_path,
            names,
            sizes_px,
            SiftOptions(
                max_num_features=max_num_features or NO_LIMIT,
                first_octave=first_octave,
                upright=upright,
                **VARIANTS[variant],
            ),
            mask_path=mask_path,
            num_threads=num_threads,
        )
        ids = {image.name: image.image_id for image in read_images(database)}
        features = []
        for name in names:
            rows = read_keypoint_rows(database, ids[name])
            values = read_descriptors(database, ids[name]).astype(np.float32)
            features.append(replace(features_of_rows(rows), descriptors=values))
    return features


def features_of_rows(rows: Float) -> Features:
    """Features from keypoint rows (K, 6) of a database: places and affine frames."""
    frame = rows[:, 2:6].reshape(-1, 2, 2)
    return Features(
        xy=rows[:, :2],
        scale_px=np.sqrt(np.maximum(np.abs(np.linalg.det(frame)), 1e-12)),
        angle_rad=np.arctan2(frame[:, 1, 0], frame[:, 0, 0]),
        affine_shape=frame,
        response=np.ones(len(rows)),
        detector_id=np.zeros(len(rows), dtype=np.int64),
        descriptors=np.zeros((len(rows), 0), dtype=np.float32),
    )


def rows_of_features(features: Features) -> Float:
    """Keypoint rows (K, 6) as a database holds them: places and affine frames."""
    return np.column_stack([features.xy, features.affine_shape.reshape(-1, 4)])


def descriptor_bytes(descriptors: Array) -> Array:
    """Descriptors of length 1 (K, 128) as COLMAP stores them: uint8."""
    return np.clip(np.rint(BYTE_SCALE * descriptors), 0, 255).astype(np.uint8)
