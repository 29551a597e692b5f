"""Descriptors -> matches of all pairs in the database, whatever detector they are of."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from semsfm_colmap.errors import InputError
from semsfm_colmap.features.registry import describe, prepare
from semsfm_colmap.io.grey import read_grey
from semsfm_colmap.matching.options import MatchingOptions
from semsfm_colmap.matching.windows import Keypoints, match_pair, through_third
from semsfm_colmap.pipeline.stage import StageRun
from semsfm_colmap.pipeline.stages.own_features import detector_options, fits_colmap
from semsfm_colmap.types import Int

Progress = Callable[[int, int], None]
ImagePair = tuple[int, int]

BLOCK_IMAGES = 6
"""What is sent to another process are the pairs between so many images and so many others, each
image once."""
NUM_THROUGH = 3
"""Images in between through which a pair's matches are followed."""


@dataclass(frozen=True, kw_only=True)
class Block:
    """Some pairs and the keypoints of their images."""

    pairs: Sequence[ImagePair]
    """numbers in the series"""
    images: Mapping[int, Keypoints]
    through: Mapping[ImagePair, Int | None]
    """see `windows.match_pair`"""


@dataclass(frozen=True, kw_only=True)
class MatchBlock:
    """Matches the pairs of a few images, in whatever process."""

    options: MatchingOptions
    seed: int

    def __call__(self, block: Block) -> list[Int]:
        """Matches (L, 2) of each pair."""
        return [
            match_pair(
                block.images[i],
                block.images[j],
                self.options,
                np.random.default_rng([self.seed, i, j]),
                block.through[i, j],
            )
            for i, j in block.pairs
        ]


def match_pairs(
    on: StageRun, names: Sequence[str], pairs: Sequence[ImagePair], *, progress: Progress
) -> None:
    """Mutual nearest neighbours with ratio, pair by pair into the database.

    Descriptors come from the database, or are computed again where they do not fit it.

    Parameters
    ----------
    names : images in acquisition order
    pairs : numbers in `names`

    """
    from semsfm_colmap.colmap.database.reader import read_database
    from semsfm_colmap.colmap.database.work import (
        pairs_without_matches,
        read_descriptors,
        read_images,
        read_keypoint_rows,
        write_matches,
    )
    from semsfm_colmap.colmap.sift_features import features_of_rows

    project, config, executor = on.project, on.config, on.executor
    ids = {image.name: image.image_id for image in read_images(project.database)}
    options = config.features

    @lru_cache(maxsize=max(2 * config.matching.overlap, 2 * BLOCK_IMAGES) + 2)
    def read(k: int) -> Keypoints:
        rows = read_keypoint_rows(project.database, ids[names[k]])
        if fits_colmap(options):
            values = read_descriptors(project.database, ids[names[k]])
            if len(rows) and not len(values):
                raise InputError(
                    f"{project.database} holds keypoints but no descriptors of {names[k]}: nothing "
                    "can be matched; run `semsfm extract --force`"
                )
            features = features_of_rows(rows[: len(values)])
        else:
            image = read_grey(project.images / names[k])
            features = features_of_rows(rows)
            values = describe(
                options.descriptor, prepare(image, None, detector_options(options)), features
            ).descriptors
        return Keypoints(
            xy=np.asarray(features.xy, dtype=np.float64),
            scale_px=features.scale_px,
            descriptors=values,
        )

    def stored(i: int, j: int) -> Int:
        a, b = ids[names[i]], ids[names[j]]
        with read_database(project.database) as reader:
            rows = reader.raw_matches((min(a, b), max(a, b)))
        return rows if a < b else rows[:, ::-1]

    id_pairs = {(ids[names[i]], ids[names[j]]): (i, j) for i, j in pairs}
    todo = [id_pairs[pair] for pair in pairs_without_matches(project.database, list(id_pairs))]
    match = MatchBlock(options=config.matching, seed=config.seed)
    done = len(pairs) - len(todo)
    # what is nearer is matched before what is farther, which is followed through it
    for gap in sorted({j - i for i, j in todo}):
        level = [(i, j) for i, j in todo if j - i == gap]
        nearer = {(i, j) for i, j in pairs if j - i < gap}

        def through(i: int, j: int, nearer: set[ImagePair] = nearer) -> Int | None:
            between = thirds(i, j, nearer)
            if not between:
                return None
            return np.concatenate([through_third(stored(i, k), stored(k, j)) for k in between])

        blocks = blocks_of(level, 1 if executor.shares_memory else BLOCK_IMAGES)
        jobs = (
            Block(
                pairs=block,
                images={k: read(k) for pair in block for k in pair},
                through={pair: through(*pair) for pair in block},
            )
            for block in blocks
        )
        for block, found in zip(blocks, executor.map(match, jobs), strict=True):
            rows = {
                (ids[names[i]], ids[names[j]]): keypoints
                for (i, j), keypoints in zip(block, found, strict=True)
            }
            write_matches(project.database, rows)
            done += len(block)
            progress(done, len(pairs))


def thirds(i: int, j: int, pairs: set[ImagePair]) -> list[int]:
    """Up to `NUM_THROUGH` images between two that pair with both, those in the middle first."""
    between = [k for k in range(i + 1, j) if (i, k) in pairs and (k, j) in pairs]
    return sorted(between, key=lambda k: (abs(2 * k - i - j), k))[:NUM_THROUGH]


def blocks_of(pairs: Sequence[ImagePair], num_images: int) -> list[list[ImagePair]]:
    """The pairs between each so many images and each so many others; with 1 each by itself."""
    blocks: dict[ImagePair, list[ImagePair]] = {}
    for i, j in pairs:
        blocks.setdefault((i // num_images, j // num_images), []).append((i, j))
    return list(blocks.values())
