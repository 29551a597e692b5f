"""COLMAP's SIFT and its matcher on the CPU, into the database, resumable image by image."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

from semsfm_colmap.colmap.database import (
    ImagePair,
    images_without_features,
    open_database,
    pairs_without_matches,
    read_images,
)
from semsfm_colmap.colmap.library import pycolmap
from semsfm_colmap.colmap.options import SiftOptions

Progress = Callable[[int, int], None]

EXTRACT_CHUNK = 8
"""Images between two progress reports."""
MATCH_CHUNK = 60
"""Pairs between two progress reports."""
DATABASE_FOCAL_FACTOR = 100.0
"""Focal length written with the images, in units of the image width: long, so that a mapper that
starts from this database starts near parallel projection."""


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
        "upright",
    ):
        setattr(extraction.sift, name, getattr(options, name))
    return extraction


def extract_sift(
    database_path: Path,
    image_path: Path,
    names: Sequence[str],
    options: SiftOptions,
    *,
    mask_path: Path | None = None,
    single_camera: bool = True,
    num_threads: int = -1,
    progress: Progress | None = None,
) -> None:
    """Extract keypoints and descriptors of the images that have none in the database yet."""
    reader = pycolmap.ImageReaderOptions()
    reader.camera_model = "SIMPLE_PINHOLE"
    reader.default_focal_length_factor = DATABASE_FOCAL_FACTOR
    if mask_path is not None:
        reader.mask_path = str(mask_path)
    extraction = extraction_options(options, num_threads)
    todo = images_without_features(database_path, names)
    if single_camera and database_path.is_file():
        with open_database(database_path) as db:
            cameras = db.read_all_cameras()
        if cameras:
            reader.existing_camera_id = cameras[0].camera_id
    done = len(names) - len(todo)
    for begin in range(0, len(todo), EXTRACT_CHUNK):
        chunk = list(todo[begin : begin + EXTRACT_CHUNK])
        pycolmap.extract_features(
            str(database_path),
            str(image_path),
            image_names=chunk,
            camera_mode=pycolmap.CameraMode.SINGLE
            if single_camera
            else pycolmap.CameraMode.PER_IMAGE,
            reader_options=reader,
            extraction_options=extraction,
            device=pycolmap.Device.cpu,
        )
        if single_camera and begin == 0 and reader.existing_camera_id < 0:
            with open_database(database_path) as db:
                reader.existing_camera_id = db.read_all_cameras()[0].camera_id
        done += len(chunk)
        if progress is not None:
            progress(done, len(names))


def match_sift(
    database_path: Path,
    pairs: Sequence[ImagePair],
    *,
    max_ratio: float,
    num_threads: int = -1,
    progress: Progress | None = None,
) -> None:
    """Match the descriptors of the pairs that have no matches yet, without verification."""
    matching = pycolmap.FeatureMatchingOptions()
    matching.use_gpu = False
    matching.num_threads = num_threads
    matching.skip_geometric_verification = True
    matching.sift.max_ratio = max_ratio
    names = {image.image_id: image.name for image in read_images(database_path)}
    todo = pairs_without_matches(database_path, pairs)
    done = len(pairs) - len(todo)
    with tempfile.TemporaryDirectory(prefix="semsfm-") as folder:
        list_path = Path(folder) / "pairs.txt"
        for begin in range(0, len(todo), MATCH_CHUNK):
            chunk = todo[begin : begin + MATCH_CHUNK]
            lines = [f"{names[a]} {names[b]}\n" for a, b in chunk]
            list_path.write_text("".join(lines), encoding="utf-8")
            pairing = pycolmap.ImportedPairingOptions()
            pairing.match_list_path = str(list_path)
            pycolmap.match_image_pairs(
                str(database_path),
                matching_options=matching,
                pairing_options=pairing,
                device=pycolmap.Device.cpu,
            )
            done += len(chunk)
            if progress is not None:
                progress(done, len(pairs))
