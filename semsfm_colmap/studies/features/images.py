"""The images of the study: prepared as a reconstruction would, read, with their true surface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from semsfm_colmap.colmap.sift_features import sift_features
from semsfm_colmap.errors import InputError
from semsfm_colmap.evaluation.truth import Truth
from semsfm_colmap.features.external import FindFeatures
from semsfm_colmap.features.options import DetectorOptions
from semsfm_colmap.features.registry import PreparedImage, prepare
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.ingest.prepare import prepare_series
from semsfm_colmap.io.grey import read_grey, read_mask
from semsfm_colmap.studies.features.options import CompareOptions
from semsfm_colmap.studies.features.transfer import Transfer
from semsfm_colmap.types import Array, Bool, Features, Float, ParallelMap


@dataclass(frozen=True, kw_only=True, eq=False)
class StudyImages:
    """The images compared: grey pixels, masks, prepared scale spaces, and who else finds keypoints.

    The study itself reads no files: `find_external` does, for COLMAP's detectors.
    """

    series: str
    """Name of the series"""
    names: tuple[str, ...]
    pixels: tuple[Array, ...]
    masks: tuple[Bool | None, ...]
    prepared: tuple[PreparedImage, ...]
    find_external: FindFeatures
    transfer: Transfer | None = None


def load_images(
    image_path: Path,
    folder: Path,
    options: CompareOptions,
    ingest: IngestOptions,
    truth: Truth | None = None,
    *,
    parallel_map: ParallelMap = map,
) -> StudyImages:
    """Prepare the images of a series in a folder (databar cut, masks) and read some of them."""
    series = prepare_series(image_path, folder, ingest)
    study = options.study
    names = series.names[:: max(study.step, 1)][: study.max_num_images]
    if len(names) < 2:
        raise InputError(
            f"{image_path} gives {len(names)} image with step {study.step}: two are needed."
        )
    masks_folder = folder / "masks"
    mask_path = masks_folder if masks_folder.is_dir() else None
    pixels = [read_grey(folder / "images" / name) for name in names]
    masks = [read_mask(mask_path, name) for name in names]

    def prepare_one(image: tuple[Array, Bool | None]) -> PreparedImage:
        return prepare(*image, options.detection)

    source = Path(image_path).resolve()
    return StudyImages(
        series=source.parent.name if source.name == "images" else source.name,
        names=names,
        pixels=tuple(pixels),
        masks=tuple(masks),
        prepared=tuple(parallel_map(prepare_one, zip(pixels, masks, strict=True))),
        find_external=colmap_finder(
            folder / "images",
            names,
            [(p.shape[1], p.shape[0]) for p in pixels],
            mask_path,
            options.detection,
        ),
        transfer=true_transfer(truth, names) if truth is not None else None,
    )


def colmap_finder(
    image_path: Path,
    names: Sequence[str],
    sizes_px: Sequence[tuple[int, int]],
    mask_path: Path | None,
    options: DetectorOptions,
) -> FindFeatures:
    """COLMAP's detectors on prepared images."""

    def find(detector: str) -> list[Features]:
        return sift_features(
            detector,
            image_path,
            names,
            sizes_px,
            max_num_features=options.max_num_features,
            upright=options.upright,
            mask_path=mask_path,
        )

    return find


def true_transfer(truth: Truth, names: tuple[str, ...]) -> Transfer:
    """True correspondences between the images named."""
    from semsfm_colmap.io.open3d_rays import ray_scene, ray_tensor

    if truth.mesh is None:
        raise InputError(f"{truth.path} holds no mesh.npz: the true surface is needed.")
    stems = {Path(name).stem: k for k, name in enumerate(truth.names)}
    missing = [name for name in names if Path(name).stem not in stems]
    if missing:
        raise InputError(f"{truth.path} does not know the image {missing[0]}.")
    rows = np.array([stems[Path(name).stem] for name in names])
    scene = ray_scene(truth.mesh.vertices, truth.mesh.faces)

    def first_hit(origin: Float, direction: Float) -> Float:
        hits = scene.cast_rays(ray_tensor(origin, direction))["t_hit"]
        return np.asarray(hits.numpy(), dtype=np.float64)

    return Transfer(
        cameras=truth.cameras.select(rows),
        first_hit=first_hit,
        radius=float(np.linalg.norm(truth.mesh.vertices, axis=1).max()),
    )
