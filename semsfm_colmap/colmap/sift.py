"""COLMAP's SIFT on the CPU, into the database, resumable image by image."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from semsfm_colmap.colmap.database.images import register_images
from semsfm_colmap.colmap.database.scratch import copy_features, scratch_database
from semsfm_colmap.colmap.database.work import (
    images_without_features,
    read_images,
)
from semsfm_colmap.colmap.library import pycolmap
from semsfm_colmap.colmap.options import SiftOptions
from semsfm_colmap.io.disk import require_space

Progress = Callable[[int, int], None]

KEYPOINT_BYTES = 2 * (6 * 4 + 128)
"""Six numbers and a descriptor, in the log and in the file."""
EXTRACT_CHUNK = 8
"""Images between two progress reports."""


def extraction_options(options: SiftOptions, num_threads: int) -> object:
    """Our options as pycolmap's."""
    extraction = pycolmap.FeatureExtractionOptions()
    extraction.use_gpu = False
    extraction.num_threads = num_threads
    for name in (
        "max_num_features",
        "first_octave",
        "peak_threshold",
        "edge_threshold",
        "estimate_affine_shape",
        "domain_size_pooling",
    ):
        setattr(extraction.sift, name, getattr(options, name))
    extraction.sift.upright = bool(options.upright)
    return extraction


def extractor_number() -> int:
    """COLMAP's number of descriptors that are compared like its SIFT."""
    return int(pycolmap.FeatureExtractorType.SIFT)


def extract_sift(
    database_path: Path,
    image_path: Path,
    names: Sequence[str],
    sizes_px: Sequence[tuple[int, int]],
    options: SiftOptions,
    *,
    mask_path: Path | None = None,
    num_threads: int = -1,
    progress: Progress | None = None,
) -> None:
    """Extract keypoints and descriptors of the images that have none in the database yet."""
    register_images(database_path, names, sizes_px)
    stored = {image.name: image for image in read_images(database_path)}
    size_of = dict(zip(names, sizes_px, strict=True))
    extraction = extraction_options(options, num_threads)
    todo = images_without_features(database_path, names)
    done = len(names) - len(todo)
    for camera_id in dict.fromkeys(stored[name].camera_id for name in todo):
        reader = pycolmap.ImageReaderOptions()
        reader.existing_camera_id = 1
        if mask_path is not None:
            reader.mask_path = str(mask_path)
        group = [name for name in todo if stored[name].camera_id == camera_id]
        for begin in range(0, len(group), EXTRACT_CHUNK):
            chunk = group[begin : begin + EXTRACT_CHUNK]
            with scratch_database(database_path) as scratch:
                # COLMAP's threads write: what does not fit there ends the process
                most = len(chunk) * options.max_num_features * KEYPOINT_BYTES
                require_space(scratch, most)
                register_images(scratch, chunk, [size_of[name] for name in chunk])
                pycolmap.extract_features(
                    str(scratch),
                    str(image_path),
                    image_names=chunk,
                    camera_mode=pycolmap.CameraMode.SINGLE,
                    reader_options=reader,
                    extraction_options=extraction,
                    device=pycolmap.Device.cpu,
                )
                id_of = {n: stored[name].image_id for n, name in enumerate(chunk, start=1)}
                copy_features(scratch, database_path, id_of)
            done += len(chunk)
            if progress is not None:
                progress(done, len(names))
