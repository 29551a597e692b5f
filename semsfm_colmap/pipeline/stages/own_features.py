"""The detectors and descriptors of `features/` in a project: into the database, and matched."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np

from semsfm_colmap.config import Config, FeatureOptions
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
from semsfm_colmap.pipeline.project import Project
from semsfm_colmap.types import Array, Features, Float, ParallelMap, SemSeries

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


def extract_own(
    project: Project,
    series: SemSeries,
    options: FeatureOptions,
    *,
    num_threads: int,
    progress: Progress,
    parallel_map: ParallelMap = map,
) -> None:
    """Detect, and describe what fits the database, in images that have no keypoints there yet.

    Parameters
    ----------
    num_threads : of COLMAP, where it takes part in a union
    parallel_map : over the images for our detectors

    """
    from semsfm_colmap.colmap.database.images import register_images
    from semsfm_colmap.colmap.database.work import (
        images_without_keypoints,
        read_images,
        write_features,
    )
    from semsfm_colmap.colmap.sift import extractor_number
    from semsfm_colmap.colmap.sift_features import descriptor_bytes, rows_of_features, sift_features

    register_images(
        project.database, series.names, [(f.width_px, f.height_px) for f in series.frames]
    )
    ids = {image.name: image.image_id for image in read_images(project.database)}
    todo = images_without_keypoints(project.database, series.names)
    detection = detector_options(options)
    stores = fits_colmap(options)

    size_of = {f.name: (f.width_px, f.height_px) for f in series.frames}

    def features_of(image: tuple[str, dict[str, Regions]]) -> Features:
        name, external = image
        prepared = prepare(
            read_grey(project.images / name), read_mask(project.masks_or_none, name), detection
        )
        found = detect(options.detector, prepared, detection, external=external)
        return describe(options.descriptor, prepared, found) if stores else found

    done = len(series.names) - len(todo)
    for begin in range(0, len(todo), CHUNK):
        chunk = todo[begin : begin + CHUNK]

        def find(detector: str, chunk: Sequence[str] = chunk) -> list[Features]:
            return sift_features(
                detector,
                project.images,
                chunk,
                [size_of[name] for name in chunk],
                max_num_features=detection.max_num_features,
                upright=detection.upright,
                mask_path=project.masks_or_none,
                num_threads=num_threads,
            )

        external = external_regions(options.detector, len(chunk), find)
        found_in = parallel_map(features_of, zip(chunk, external, strict=True))
        for name, found in zip(chunk, found_in, strict=True):
            descriptors = None
            if stores:
                descriptors = extractor_number(), descriptor_bytes(found.descriptors)
            write_features(project.database, ids[name], rows_of_features(found), descriptors)
            done += 1
            progress(done, len(series.names))


def match_own(
    project: Project,
    names: Sequence[str],
    pairs: Sequence[tuple[int, int]],
    config: Config,
    *,
    progress: Progress,
    parallel_map: ParallelMap = map,
) -> None:
    """Mutual nearest neighbours with ratio by exact search, pair by pair into the database.

    Descriptors come from the database, or are computed again where they do not fit it.

    Parameters
    ----------
    names : images in acquisition order
    pairs : numbers in `names`
    parallel_map : over the parts of a pair's distances

    """
    from semsfm_colmap.colmap.database.work import (
        pairs_without_matches,
        read_descriptors,
        read_images,
        read_keypoint_rows,
        write_matches,
    )
    from semsfm_colmap.colmap.sift_features import features_of_rows
    from semsfm_colmap.matching.nearest import match_nearest

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
    for done, (a, b) in enumerate(todo, start=1):
        (xy1, values1), (xy2, values2) = (read(k) for k in by_id[a, b])
        found = match_nearest(
            values1,
            values2,
            max_ratio=config.matching.max_ratio,
            parallel_map=parallel_map,
            xy1=xy1,
            xy2=xy2,
            exclusion_px=config.matching.exclusion_px,
        )
        write_matches(project.database, {(a, b): found.keypoints})
        progress(len(pairs) - len(todo) + done, len(pairs))
