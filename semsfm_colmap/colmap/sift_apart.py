"""COLMAP's SIFT as jobs for other processes: nothing but their results comes back.

A job fills a database of its own in a temporary folder, as `sift.py` does beside the project's; the
project's database is written by the process that asked, image by image, and holds the same rows.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from semsfm_colmap.colmap.database.images import register_images
from semsfm_colmap.colmap.database.reader import read_database
from semsfm_colmap.colmap.database.scratch import NO_SIFT
from semsfm_colmap.colmap.database.work import (
    images_without_features,
    read_images,
    write_features,
)
from semsfm_colmap.colmap.options import SiftOptions
from semsfm_colmap.colmap.sift import extract_sift
from semsfm_colmap.io.temporary import temporary_folder
from semsfm_colmap.types import Array, ParallelMap

Progress = Callable[[int, int], None]
StoredFeatures = tuple[Array, tuple[int, Array]]
"""Keypoints (K, 4 or 6) float32; COLMAP's number of the extractor and descriptors (K, 128) uint8"""


@dataclass(frozen=True, kw_only=True)
class SiftOfImage:
    """COLMAP's SIFT of one image."""

    image_path: Path
    options: SiftOptions
    mask_path: Path | None

    def __call__(self, image: tuple[str, tuple[int, int]]) -> StoredFeatures:
        """The features of an image, given its name and its width and height."""
        name, size_px = image
        with temporary_folder() as folder:
            database = Path(folder) / "features.db"
            extract_sift(
                database,
                self.image_path,
                [name],
                [size_px],
                self.options,
                mask_path=self.mask_path,
                num_threads=1,
            )
            return next(stored_features(database, [1]))


def extract_sift_apart(
    database_path: Path,
    image_path: Path,
    names: Sequence[str],
    sizes_px: Sequence[tuple[int, int]],
    options: SiftOptions,
    *,
    mask_path: Path | None,
    parallel_map: ParallelMap,
    progress: Progress,
) -> None:
    """What `sift.extract_sift` does, the images spread over other processes.

    Parameters
    ----------
    image_path, mask_path : folders that those processes see under the same path
    parallel_map : over the images

    """
    register_images(database_path, names, sizes_px)
    ids = {image.name: image.image_id for image in read_images(database_path)}
    size_of = dict(zip(names, sizes_px, strict=True))
    # all images of one size after another, as `extract_sift` has it
    todo = images_without_features(database_path, names)
    sizes = dict.fromkeys(sizes_px)
    todo = [name for size in sizes for name in todo if size_of[name] == size]
    find = SiftOfImage(image_path=image_path, options=options, mask_path=mask_path)
    found = parallel_map(find, [(name, size_of[name]) for name in todo])
    done = len(names) - len(todo)
    for name, (keypoints, descriptors) in zip(todo, found, strict=True):
        write_features(database_path, ids[name], keypoints, descriptors)
        done += 1
        progress(done, len(names))


def stored_features(database_path: Path, ids: Sequence[int]) -> Iterator[StoredFeatures]:
    """Features of some images; no descriptors where nothing was found."""
    with read_database(database_path) as reader:
        for image_id in ids:
            yield reader.keypoints(image_id), reader.descriptors(image_id) or NO_SIFT
