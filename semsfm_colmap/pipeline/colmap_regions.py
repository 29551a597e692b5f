"""COLMAP's SIFT keypoints as regions, for unions with our detectors and for the comparison."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from semsfm_colmap.colmap.options import SiftOptions
from semsfm_colmap.features.frames import PIXEL_CENTRE
from semsfm_colmap.features.options import DetectorOptions
from semsfm_colmap.features.regions import Regions, regions_from_frames
from semsfm_colmap.features.registry import EXTERNAL, external_parts
from semsfm_colmap.types import Features, Float

NO_LIMIT = 10**6
VARIANTS: dict[str, dict[str, Any]] = {
    "colmap-sift": {},
    "colmap-sift-affine": {"estimate_affine_shape": True},
    "colmap-sift-pooled": {"domain_size_pooling": True},
}


def colmap_features(
    detector: str,
    image_path: Path,
    names: Sequence[str],
    sizes_px: Sequence[tuple[int, int]],
    options: DetectorOptions,
    *,
    first_octave: int = SiftOptions.first_octave,
    mask_path: Path | None = None,
    num_threads: int = -1,
) -> list[Features]:
    """Keypoints of some images with COLMAP's own descriptors.

    Parameters
    ----------
    detector : one of `VARIANTS`
    sizes_px : width and height of each

    """
    from semsfm_colmap.colmap.database.work import read_descriptors, read_images, read_keypoint_rows
    from semsfm_colmap.colmap.sift import extract_sift

    with tempfile.TemporaryDirectory(prefix="semsfm-") as folder:
        database = Path(folder) / "features.db"
        extract_sift(
            database,
            image_path,
            names,
            sizes_px,
            SiftOptions(
                max_num_features=options.max_num_features or NO_LIMIT,
                first_octave=first_octave,
                upright=options.upright,
                **VARIANTS[detector],
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


def colmap_regions(
    union: str,
    image_path: Path,
    names: Sequence[str],
    sizes_px: Sequence[tuple[int, int]],
    options: DetectorOptions,
    *,
    mask_path: Path | None = None,
    num_threads: int = -1,
) -> list[dict[str, Regions]]:
    """What COLMAP's detectors in a union find in each image.

    COLMAP does not say how strong a keypoint is; over its limit it prefers large ones, and so the
    scale stands for the strength.
    """
    result: list[dict[str, Regions]] = [{} for _ in names]
    for detector in external_parts(union):
        found = colmap_features(
            detector,
            image_path,
            names,
            sizes_px,
            options,
            mask_path=mask_path,
            num_threads=num_threads,
        )
        for regions, features in zip(result, found, strict=True):
            regions[detector] = regions_from_frames(
                features.xy - PIXEL_CENTRE,
                features.affine_shape,
                features.scale_px,
                EXTERNAL[detector],
            )
    return result


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
