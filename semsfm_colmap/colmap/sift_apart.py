"""COLMAP's SIFT and its matcher as jobs for other processes: nothing but their results comes back.

A job fills a database of its own in a temporary folder, as `sift.py` does beside the project's; the
project's database is written by the process that asked, image by image and block by block, and
holds the same rows. A block of pairs shares images: each of them is sent and prepared once.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from semsfm_colmap.colmap.database.images import register_images
from semsfm_colmap.colmap.database.reader import ImagePair, read_database
from semsfm_colmap.colmap.database.scratch import NO_SIFT
from semsfm_colmap.colmap.database.work import (
    images_without_features,
    pairs_without_matches,
    read_images,
    write_features,
    write_matches,
)
from semsfm_colmap.colmap.options import SiftOptions
from semsfm_colmap.colmap.sift import extract_sift, match_listed
from semsfm_colmap.types import Array, ParallelMap

Progress = Callable[[int, int], None]
StoredFeatures = tuple[Array, tuple[int, Array]]
"""Keypoints (K, 4 or 6) float32; COLMAP's number of the extractor and descriptors (K, 128) uint8"""

BLOCK_IMAGES = 6
"""A block holds the pairs between so many images and so many others: COLMAP prepares an image for
the search once a block, which takes as long as one or two pairs."""


@dataclass(frozen=True, kw_only=True)
class SiftOfImage:
    """COLMAP's SIFT of one image."""

    image_path: Path
    options: SiftOptions
    mask_path: Path | None

    def __call__(self, image: tuple[str, tuple[int, int]]) -> StoredFeatures:
        """The features of an image, given its name and its width and height."""
        name, size_px = image
        with tempfile.TemporaryDirectory(prefix="semsfm-") as folder:
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


@dataclass(frozen=True, kw_only=True)
class MatchesOfBlock:
    """COLMAP's matches of some pairs of few images."""

    max_ratio: float

    def __call__(self, block: tuple[Sequence[StoredFeatures], Sequence[ImagePair]]) -> list[Array]:
        """Raw matches (L, 2) of each pair, given features and pairs of numbers from 1."""
        features, pairs = block
        with tempfile.TemporaryDirectory(prefix="semsfm-") as folder:
            scratch = Path(folder) / "matches.db"
            names = [f"{n}.png" for n in range(1, len(features) + 1)]
            register_images(scratch, names, [(1, 1)] * len(names))
            for number, (keypoints, descriptors) in enumerate(features, start=1):
                write_features(scratch, number, keypoints, descriptors)
            match_listed(
                scratch,
                pairs,
                Path(folder) / "pairs.txt",
                max_ratio=self.max_ratio,
                num_threads=1,
            )
            with read_database(scratch) as reader:
                return [reader.raw_matches((min(pair), max(pair))) for pair in pairs]


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


def match_sift_apart(
    database_path: Path,
    pairs: Sequence[ImagePair],
    *,
    max_ratio: float,
    parallel_map: ParallelMap,
    progress: Progress,
) -> None:
    """What `sift.match_sift` does, blocks of pairs spread over other processes.

    Parameters
    ----------
    parallel_map : over the blocks; files of the project are not read there

    """
    todo = pairs_without_matches(database_path, pairs)
    blocks = blocks_of(todo)
    done = len(pairs) - len(todo)
    match = MatchesOfBlock(max_ratio=max_ratio)
    found = parallel_map(match, (block_of(database_path, block) for block in blocks))
    for block, matches in zip(blocks, found, strict=True):
        sorted_pairs = [(min(pair), max(pair)) for pair in block]
        write_matches(database_path, dict(zip(sorted_pairs, matches, strict=True)))
        done += len(block)
        progress(done, len(pairs))


def blocks_of(pairs: Sequence[ImagePair]) -> list[list[ImagePair]]:
    """The pairs between each `BLOCK_IMAGES` images and each others, in the order of the images."""
    ids = sorted({image_id for pair in pairs for image_id in pair})
    group = {image_id: n // BLOCK_IMAGES for n, image_id in enumerate(ids)}
    blocks: dict[tuple[int, int], list[ImagePair]] = {}
    for a, b in pairs:
        blocks.setdefault((group[a], group[b]), []).append((a, b))
    return list(blocks.values())


def block_of(
    database_path: Path, pairs: Sequence[ImagePair]
) -> tuple[list[StoredFeatures], list[ImagePair]]:
    """The features of the images of some pairs, and the pairs with numbers of these from 1."""
    ids = sorted({image_id for pair in pairs for image_id in pair})
    number = {image_id: n for n, image_id in enumerate(ids, start=1)}
    features = list(stored_features(database_path, ids))
    return features, [(number[a], number[b]) for a, b in pairs]


def stored_features(database_path: Path, ids: Sequence[int]) -> Iterator[StoredFeatures]:
    """Features of some images; no descriptors where nothing was found."""
    with read_database(database_path) as reader:
        for image_id in ids:
            yield reader.keypoints(image_id), reader.descriptors(image_id) or NO_SIFT
