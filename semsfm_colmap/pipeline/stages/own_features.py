"""The detectors and descriptors of `features/` in a project: into the database."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from semsfm_colmap.config import FeatureOptions
from semsfm_colmap.features.external import external_regions
from semsfm_colmap.features.opencv_sift import opencv_sift
from semsfm_colmap.features.options import DetectorOptions
from semsfm_colmap.features.regions import Regions
from semsfm_colmap.features.registry import (
    describe,
    descriptor_entry,
    detect,
    detector_parts,
    external_parts,
    prepare,
)
from semsfm_colmap.io.grey import read_grey, read_mask
from semsfm_colmap.pipeline.stage import StageRun
from semsfm_colmap.types import Array, Bool, Features, SemSeries

Progress = Callable[[int, int], None]
COLMAP_SIFT = "sift"
"""The detector that is COLMAP's own."""
OPENCV_SIFT = "opencv-sift"
"""The detector that is OpenCV's, with its descriptor."""
CHUNK = 8
"""Images whose COLMAP keypoints are found together."""


def is_own(options: FeatureOptions) -> bool:
    """False for COLMAP's SIFT; unknown names are refused."""
    if options.detector in (COLMAP_SIFT, OPENCV_SIFT):
        return options.detector == OPENCV_SIFT
    detector_parts(options.detector)
    descriptor_entry(options.descriptor)
    return True


def fits_colmap(options: FeatureOptions) -> bool:
    """True when the descriptors can stand in COLMAP's table."""
    if not is_own(options) or options.detector == OPENCV_SIFT:
        return True
    return descriptor_entry(options.descriptor).colmap


def detector_options(options: FeatureOptions) -> DetectorOptions:
    """What all detectors have in common."""
    return DetectorOptions(max_num_features=options.max_num_features, upright=bool(options.upright))


def sift_of(pixels: Array, mask: Bool | None, options: FeatureOptions) -> Features:
    """OpenCV's SIFT of an image as the options want it."""
    return opencv_sift(
        pixels,
        mask,
        max_num_features=options.max_num_features,
        first_octave=options.first_octave,
        peak_threshold=options.peak_threshold,
        edge_threshold=options.edge_threshold,
        upright=bool(options.upright),
    )


@dataclass(frozen=True, kw_only=True)
class FindOwn:
    """Finds the features of an image with detectors of ours, in whatever process."""

    image_path: Path
    mask_path: Path | None
    options: FeatureOptions

    def __call__(self, image: tuple[str, dict[str, Regions]]) -> Features:
        """Features of an image, given its name and what other programs have found in it."""
        name, external = image
        pixels, mask = read_grey(self.image_path / name), read_mask(self.mask_path, name)
        if self.options.detector == OPENCV_SIFT:
            return sift_of(pixels, mask, self.options)
        detection = detector_options(self.options)
        prepared = prepare(pixels, mask, detection)
        found = detect(self.options.detector, prepared, detection, external=external)
        if not fits_colmap(self.options):
            return found
        return describe(self.options.descriptor, prepared, found)


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
    from_others = options.detector != OPENCV_SIFT and external_parts(options.detector)
    length = max(CHUNK, on.executor.num_workers) if from_others else max(len(todo), 1)
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

        external: Sequence[dict[str, Regions]] = [{}] * len(chunk)
        if from_others:
            external = external_regions(options.detector, len(chunk), find)
        found_in = on.executor.map(features_of, zip(chunk, external, strict=True))
        for name, found in zip(chunk, found_in, strict=True):
            descriptors = None
            if stores:
                descriptors = extractor_number(), descriptor_bytes(found.descriptors)
            write_features(project.database, ids[name], rows_of_features(found), descriptors)
            done += 1
            progress(done, len(series.names))
