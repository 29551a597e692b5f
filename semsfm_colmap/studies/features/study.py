"""The paper's study of detectors and descriptors, on images that are there.

For each detector the regions of some consecutive images are found, for each descriptor described,
matched with the next image, filtered by distance and verified; counted before and after. With a
true surface it is also known which matches are right.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from semsfm_colmap.features.external import external_regions
from semsfm_colmap.features.regions import Regions, circular_regions
from semsfm_colmap.features.registry import (
    PreparedImage,
    describe,
    detect,
    external_parts,
    prepare,
)
from semsfm_colmap.matching.filters import distance_filter, static_matches
from semsfm_colmap.matching.nearest import match_nearest
from semsfm_colmap.matching.verify import verify_pair
from semsfm_colmap.studies.features.agreement import (
    Repeatability,
    overlap_share,
    repeatability,
    shared_regions,
)
from semsfm_colmap.studies.features.images import StudyImages
from semsfm_colmap.studies.features.options import (
    COLMAP_DETECTORS,
    CompareOptions,
    StudyOptions,
)
from semsfm_colmap.studies.features.result import DetectorSpeed, PairCount, StudyResult
from semsfm_colmap.types import Array, Bool, Features, Float, ParallelMap

Progress = Callable[[int, int], None]


def run_study(
    images: StudyImages,
    options: CompareOptions,
    *,
    parallel_map: ParallelMap = map,
    progress: Progress | None = None,
) -> StudyResult:
    """All counts of all combinations.

    Parameters
    ----------
    parallel_map : over the images, and over the pairs
    progress : called with the numbers of combinations done and in all

    """
    study = options.study
    counts: list[PairCount] = []
    speed: list[DetectorSpeed] = []
    regions: dict[str, list[Features]] = {}
    repeated: dict[str, tuple[Repeatability, ...]] = {}
    total, done = len(study.detectors) * len(study.descriptors), 0
    for detector in study.detectors:
        features, entry = time_features(detector, images, options, parallel_map)
        speed.append(entry)
        regions[detector] = features
        if images.transfer is not None:
            repeated[detector] = _repeatability(images, features, study)
        for descriptor in study.descriptors:
            described = _described(descriptor, images, features, options, parallel_map)

            def count(
                k: int,
                detector: str = detector,
                descriptor: str = descriptor,
                described: list[Features] = described,
            ) -> PairCount:
                return _count_pair(detector, descriptor, k, images, described[k : k + 2], options)

            counts += parallel_map(count, range(len(described) - 1))
            done += 1
            if progress is not None:
                progress(done, total)
    return StudyResult(
        series=images.series,
        image_names=images.names,
        detectors=study.detectors,
        descriptors=study.descriptors,
        counts=tuple(counts),
        overlap=_overlap(regions, study),
        speed=tuple(speed),
        repeatability=repeated,
        first_images=tuple(
            np.column_stack([f[0].xy, f[0].affine_shape.reshape(-1, 4)]) for f in regions.values()
        ),
        has_truth=images.transfer is not None,
    )


def _described(
    descriptor: str,
    images: StudyImages,
    features: list[Features],
    options: CompareOptions,
    parallel_map: ParallelMap,
) -> list[Features]:
    """The features of the first images, as many as are to be matched, with their descriptors.

    They come with SIFT, those of COLMAP with COLMAP's own.
    """
    if descriptor == "sift":
        return features
    num = len(features)
    if options.study.max_num_pairs > 0:
        num = min(num, options.study.max_num_pairs + 1)

    def describe_one(image: tuple[PreparedImage, Features]) -> Features:
        return describe(descriptor, *image, options.description)

    return list(parallel_map(describe_one, zip(images.prepared[:num], features[:num], strict=True)))


def time_features(
    detector: str, images: StudyImages, options: CompareOptions, parallel_map: ParallelMap = map
) -> tuple[list[Features], DetectorSpeed]:
    """Regions of all images; the time includes scale space, detection and SIFT."""
    if detector in COLMAP_DETECTORS:
        begin = time.perf_counter()
        features = list(images.find_external(detector))
        seconds = time.perf_counter() - begin
    else:

        def both(image: tuple[Array, Bool | None, dict[str, Regions]]) -> Features:
            pixels, mask, external = image
            prepared = prepare(pixels, mask, options.detection)
            found = detect(detector, prepared, options.detection, external=external)
            return describe("sift", prepared, found, options.description)

        # once beforehand on a corner: compiled code is loaded, not timed
        nowhere = circular_regions(np.zeros((0, 2)), np.zeros(0), np.zeros(0), 0)
        both((images.pixels[0][:64, :64], None, dict.fromkeys(external_parts(detector), nowhere)))
        begin = time.perf_counter()
        external = external_regions(detector, len(images.names), images.find_external)
        jobs = zip(images.pixels, images.masks, external, strict=True)
        features = list(parallel_map(both, jobs))
        seconds = time.perf_counter() - begin
    num = sum(len(f.scale_px) for f in features)
    return features, DetectorSpeed(detector=detector, num_features=num, seconds=seconds)


def _count_pair(
    detector: str,
    descriptor: str,
    k: int,
    images: StudyImages,
    features: list[Features],
    options: CompareOptions,
) -> PairCount:
    """Match two consecutive images and count what each filter leaves."""
    study, matching = options.study, options.matching
    first, second = features
    matches = match_nearest(
        first.descriptors,
        second.descriptors,
        max_ratio=matching.max_ratio,
        xy1=first.xy,
        xy2=second.xy,
        exclusion_px=study.exclusion_px,
    ).keypoints
    displacement = second.xy[matches[:, 1]] - first.xy[matches[:, 0]]
    plausible = distance_filter(displacement, matching.distance_filter_sigmas)
    plausible &= ~static_matches(displacement, matching.static_radius_px, matching.static_excess)
    verified = verify_pair((k, k + 1), first.xy, second.xy, matches, matching, study.seed)
    count = PairCount(
        detector=detector,
        descriptor=descriptor,
        first=k,
        matched=len(matches),
        heuristic=int(plausible.sum()),
        robust=int(verified.inlier.sum()),
    )
    if images.transfer is None:
        return count
    predicted = images.transfer.predict(k, k + 1, first.xy[matches[:, 0]])
    error = np.linalg.norm(predicted - second.xy[matches[:, 1]], axis=1)
    known = np.isfinite(error)
    right = known & (np.nan_to_num(error, nan=np.inf) < study.true_error_px)
    kept = right & verified.inlier
    return replace(
        count,
        true_matched=int(right.sum()),
        true_robust=int(kept.sum()),
        known_matched=int(known.sum()),
        known_robust=int((known & verified.inlier).sum()),
        error_px=float(np.median(error[kept])) if kept.any() else float("nan"),
    )


def _overlap(regions: dict[str, list[Features]], study: StudyOptions) -> Float:
    """(D, D) average over the images of the regions that two detectors share."""
    names = list(regions)
    share = np.eye(len(names))
    for i, a in enumerate(names):
        for j in range(i):
            b = names[j]
            values = []
            for one, other in zip(regions[a], regions[b], strict=True):
                shared = shared_regions(
                    one.xy,
                    one.scale_px,
                    other.xy,
                    other.scale_px,
                    max_px=study.overlap_px,
                    scale_ratio=study.overlap_scale_ratio,
                )
                values.append(overlap_share(len(shared), len(one.xy), len(other.xy)))
            share[i, j] = share[j, i] = float(np.mean(values))
    return share


def _repeatability(
    images: StudyImages, features: list[Features], study: StudyOptions
) -> tuple[Repeatability, ...]:
    """Regions of the first image found again in the others, by rising angle."""
    assert images.transfer is not None
    h, w = images.pixels[0].shape
    entries = []
    for k in range(1, len(features)):
        angle = images.transfer.angle_deg(0, k)
        if angle > study.max_angle_deg:
            continue
        predicted = images.transfer.predict(0, k, features[0].xy)
        inside = np.all((predicted > 8) & (predicted < [w - 8, h - 8]), axis=1)
        entries.append(
            repeatability(
                predicted,
                features[0].scale_px,
                features[k].xy,
                features[k].scale_px,
                usable=inside,
                angle_deg=angle,
                max_px=study.true_error_px,
                scale_ratio=study.overlap_scale_ratio,
            )
        )
    return tuple(sorted(entries, key=lambda entry: entry.angle_deg))
