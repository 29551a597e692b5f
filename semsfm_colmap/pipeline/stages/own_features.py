"""The detectors and descriptors of `features/` in a project: into the database, and matched."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from semsfm_colmap.config import FeatureOptions
from semsfm_colmap.features.external import external_regions
from semsfm_colmap.features.options import DetectorOptions
from semsfm_colmap.features.regions import Regions
from semsfm_colmap.features.registry import (
    describe,
    descriptor_entry,
    detect,
    detector_parts,
    prepare,
)
from semsfm_colmap.io.grey import read_grey, read_mask
from semsfm_colmap.pipeline.stage import StageRun
from semsfm_colmap.types import Array, Features, Float, Int, ParallelMap, SemSeries

Progress = Callable[[int, int], None]
COLMAP_SIFT = "sift"
"""The detector that is COLMAP's own."""
CHUNK = 8
"""Images whose COLMAP keypoints are found together."""


def is_own(options: FeatureOptions) -> bool:
    """True for a detector of ours; unknown names are refused."""
    if options.detector == COLMAP_SIFT:
        return False
    detector_parts(options.detector)
    descriptor_entry(options.descriptor)
    return True


def fits_colmap(options: FeatureOptions) -> bool:
    """True when the descriptors can stand in COLMAP's table."""
    return not is_own(options) or descriptor_entry(options.descriptor).colmap


def detector_options(options: FeatureOptions) -> DetectorOptions:
    """What all detectors have in common."""
    return DetectorOptions(max_num_features=options.max_num_features, upright=bool(options.upright))


@dataclass(frozen=True, kw_only=True)
class FindOwn:
    """Finds the features of an image with detectors of ours, in whatever process."""

    image_path: Path
    mask_path: Path | None
    options: FeatureOptions

    def __call__(self, image: tuple[str, dict[str, Regions]]) -> Features:
        """Features of an image, given its name and what other programs have found in it."""
        name, external = image
        detection = detector_options(self.options)
        prepared = prepare(
            read_grey(self.image_path / name), read_mask(self.mask_path, name), detection
        )
        found = detect(self.options.detector, prepared, detection, external=external)
        if not fits_colmap(self.options):
            return found
        return describe(self.options.descriptor, prepared, found)


@dataclass(frozen=True, kw_only=True)
class MatchOwn:
    """Matches the descriptors of a pair, in whatever process."""

    max_ratio: float
    exclusion_px: float
    parallel_map: ParallelMap
    """over the parts of a pair's distances"""

    def __call__(self, pair: tuple[tuple[Float, Array], tuple[Float, Array]]) -> Int:
        """Matches (L, 2) of two images, given places (K, 2) and descriptors (K, D) of each."""
        from semsfm_colmap.matching.nearest import match_nearest

        (xy1, values1), (xy2, values2) = pair
        return match_nearest(
            values1,
            values2,
            max_ratio=self.max_ratio,
            parallel_map=self.parallel_map,
            xy1=xy1,
            xy2=xy2,
            exclusion_px=self.exclusion_px,
        ).keypoints


def extract_own(
    on: StageRun, series: SemSeries, options: FeatureOptions, *, progress: Progress
) -> None:
    """Detect, and describe what fits the database, in images that have no keypoints there yet.

    The images are spread over the workers; COLMAP, where it takes part in a union, works here.
    """
    from semsfm_colmap.colmap.database.images import register_images
    from semsfm_colmap.colmap.database.work import (
        images_without_keypoints,
        read_images,
        write_features,
    )
    from semsfm_colmap.colmap.sift import extractor_number
    from semsfm_colmap.colmap.sift_features import descriptor_bytes, rows_of_features, sift_features

    project, mask_path = on.project, on.project.masks_or_none
    register_images(
        project.database, series.names, [(f.width_px, f.height_px) for f in series.frames]
    )
    ids = {image.name: image.image_id for image in read_images(project.database)}
    todo = images_without_keypoints(project.database, series.names)
    detection = detector_options(options)
    stores = fits_colmap(options)

    size_of = {f.name: (f.width_px, f.height_px) for f in series.frames}

    features_of = FindOwn(image_path=project.images, mask_path=mask_path, options=options)
    done = len(series.names) - len(todo)
    length = max(CHUNK, on.executor.num_workers)
    for begin in range(0, len(todo), length):
        chunk = todo[begin : begin + length]

        def find(detector: str, chunk: Sequence[str] = chunk) -> list[Features]:
            return sift_features(
                detector,
                project.images,
                chunk,
                [size_of[name] for name in chunk],
                max_num_features=detection.max_num_features,
                upright=detection.upright,
                mask_path=mask_path,
                num_threads=on.local.num_workers,
            )

        external = external_regions(options.detector, len(chunk), find)
        found_in = on.executor.map(features_of, zip(chunk, external, strict=True))
        for name, found in zip(chunk, found_in, strict=True):
            descriptors = None
            if stores:
                descriptors = extractor_number(), descriptor_bytes(found.descriptors)
            write_features(project.database, ids[name], rows_of_features(found), descriptors)
            done += 1
            progress(done, len(series.names))


def match_own(
    on: StageRun, names: Sequence[str], pairs: Sequence[tuple[int, int]], *, progress: Progress
) -> None:
    """Mutual nearest neighbours with ratio by exact search, pair by pair into the database.

    Descriptors come from the database, or are computed again where they do not fit it. Threads of
    this process work on one pair together, other processes on a pair each.

    Parameters
    ----------
    names : images in acquisition order
    pairs : numbers in `names`

    """
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

    @lru_cache(maxsize=2 * config.matching.overlap + 2)
    def read(k: int) -> tuple[Float, Array]:
        rows = read_keypoint_rows(project.database, ids[names[k]])
        if fits_colmap(options):
            values = read_descriptors(project.database, ids[names[k]]).astype(np.float32)
            return rows[: len(values), :2], values
        image = read_grey(project.images / names[k])
        features = features_of_rows(rows)
        values = describe(
            options.descriptor, prepare(image, None, detector_options(options)), features
        ).descriptors
        return rows[:, :2], np.asarray(values, dtype=np.float32)

    by_id = {(ids[names[i]], ids[names[j]]): (i, j) for i, j in pairs}
    todo = pairs_without_matches(project.database, list(by_id))
    over_pairs: ParallelMap = executor.map
    over_parts: ParallelMap = map
    if executor.shares_memory:
        over_pairs, over_parts = map, executor.map
    match = MatchOwn(
        max_ratio=config.matching.max_ratio,
        exclusion_px=config.matching.exclusion_px,
        parallel_map=over_parts,
    )
    images = (by_id[pair] for pair in todo)
    found = over_pairs(match, ((read(i), read(j)) for i, j in images))
    for done, (pair, keypoints) in enumerate(zip(todo, found, strict=True), start=1):
        write_matches(project.database, {pair: keypoints})
        progress(len(pairs) - len(todo) + done, len(pairs))
