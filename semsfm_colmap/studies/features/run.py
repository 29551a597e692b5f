"""`semsfm compare-features`: the paper's study of detectors and descriptors on any series.

For each detector the regions of some consecutive images are found, for each descriptor described,
matched with the next image, filtered by distance and verified; counted before and after. With a
true surface it is also known which matches are right.
"""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from semsfm_colmap.errors import InputError
from semsfm_colmap.evaluation.truth import Truth, load_truth
from semsfm_colmap.features.options import DescriptorOptions, DetectorOptions
from semsfm_colmap.features.regions import Regions, circular_regions
from semsfm_colmap.features.registry import (
    PreparedImage,
    describe,
    descriptor_entry,
    detect,
    detector_parts,
    external_parts,
    prepare,
)
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.ingest.prepare import prepare_series
from semsfm_colmap.matching.filters import distance_filter, static_matches
from semsfm_colmap.matching.nearest import match_nearest
from semsfm_colmap.matching.options import MatchingOptions
from semsfm_colmap.matching.verify import verify_pair
from semsfm_colmap.pipeline.colmap_regions import colmap_features, colmap_regions
from semsfm_colmap.pipeline.reporter import Reporter
from semsfm_colmap.studies.features.agreement import (
    Repeatability,
    overlap_share,
    repeatability,
    shared_regions,
)
from semsfm_colmap.studies.features.figures import write_figures
from semsfm_colmap.studies.features.options import COLMAP_DETECTORS, StudyOptions
from semsfm_colmap.studies.features.result import DetectorSpeed, PairCount, StudyResult
from semsfm_colmap.studies.features.tables import write_tables
from semsfm_colmap.studies.features.transfer import Transfer
from semsfm_colmap.types import Array, Bool, Features, Float

Progress = Callable[[int, int], None]


@dataclass(frozen=True, kw_only=True)
class CompareOptions:
    """The options of all that takes part."""

    study: StudyOptions = field(default_factory=StudyOptions)
    detection: DetectorOptions = field(default_factory=DetectorOptions)
    description: DescriptorOptions = field(default_factory=DescriptorOptions)
    matching: MatchingOptions = field(default_factory=MatchingOptions)


@dataclass(frozen=True, kw_only=True, eq=False)
class StudyImages:
    """The images compared: grey pixels, masks, prepared scale spaces, and where they lie."""

    names: tuple[str, ...]
    pixels: tuple[Array, ...]
    masks: tuple[Bool | None, ...]
    prepared: tuple[PreparedImage, ...]
    folder: Path
    """A project folder with images/ and masks/"""
    transfer: Transfer | None = None


def compare_features(
    image_path: Path,
    output_path: Path,
    *,
    options: CompareOptions,
    ingest: IngestOptions,
    truth_path: Path | None = None,
    reporter: Reporter | None = None,
) -> StudyResult:
    """Run the study on a folder of images and write its figures and tables to `output_path`."""
    reporter = reporter or Reporter()
    study = options.study
    for detector in study.detectors:
        detector_parts(detector)
    for descriptor in study.descriptors:
        descriptor_entry(descriptor)
    truth = load_truth(truth_path) if truth_path is not None else None
    with tempfile.TemporaryDirectory(prefix="semsfm-") as folder:
        images = load_images(Path(image_path), Path(folder), options, ingest, truth)
        with reporter.progress("compare") as progress:
            result = run_study(Path(image_path).resolve(), images, options, progress=progress)
    write_tables(result, output_path)
    write_figures(result, output_path, images.pixels[0])
    reporter.say(f"{len(result.counts)} combinations of pairs compared; see {output_path}")
    return result


def load_images(
    image_path: Path,
    folder: Path,
    options: CompareOptions,
    ingest: IngestOptions,
    truth: Truth | None,
) -> StudyImages:
    """Prepare the images as a reconstruction would (databar cut, masks) and read some of them."""
    import cv2

    series = prepare_series(image_path, folder, ingest)
    study = options.study
    names = series.names[:: max(study.step, 1)][: study.max_num_images]
    if len(names) < 2:
        raise InputError(
            f"{image_path} gives {len(names)} image with step {study.step}: two are needed."
        )
    pixels, masks = [], []
    for name in names:
        pixels.append(np.asarray(cv2.imread(str(folder / "images" / name), cv2.IMREAD_GRAYSCALE)))
        mask_file = folder / "masks" / f"{name}.png"
        drawn = cv2.imread(str(mask_file), cv2.IMREAD_GRAYSCALE) if mask_file.is_file() else None
        masks.append(None if drawn is None else np.asarray(drawn > 0))
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        prepared = list(pool.map(lambda p, m: prepare(p, m, options.detection), pixels, masks))
    return StudyImages(
        names=names,
        pixels=tuple(pixels),
        masks=tuple(masks),
        prepared=tuple(prepared),
        folder=folder,
        transfer=_transfer(truth, names) if truth is not None else None,
    )


def _transfer(truth: Truth, names: tuple[str, ...]) -> Transfer:
    """True correspondences between the images named."""
    from semsfm_colmap.geometry.rays import ray_scene, ray_tensor

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


def run_study(
    series_path: Path,
    images: StudyImages,
    options: CompareOptions,
    *,
    progress: Progress | None = None,
) -> StudyResult:
    """All counts of all combinations."""
    study = options.study
    num = len(images.names)
    counts: list[PairCount] = []
    speed: list[DetectorSpeed] = []
    regions: dict[str, list[Features]] = {}
    repeated: dict[str, tuple[Repeatability, ...]] = {}
    total, done = len(study.detectors) * len(study.descriptors), 0
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for detector in study.detectors:
            features, entry = time_features(detector, images, options, pool)
            speed.append(entry)
            regions[detector] = features
            if images.transfer is not None:
                repeated[detector] = _repeatability(images, features, study)
            for descriptor in study.descriptors:
                some = num
                if descriptor != "sift" and study.max_num_pairs > 0:
                    some = min(num, study.max_num_pairs + 1)
                described = features[:some]
                # the features come with SIFT, those of COLMAP with COLMAP's own
                if descriptor != "sift":
                    describe_one = _describer(descriptor, options.description)
                    described = list(pool.map(describe_one, images.prepared[:some], described))
                counts += [
                    _count_pair(detector, descriptor, k, images, described[k : k + 2], options)
                    for k in range(some - 1)
                ]
                done += 1
                if progress is not None:
                    progress(done, total)
    return StudyResult(
        series=series_path.parent.name if series_path.name == "images" else series_path.name,
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


def _describer(
    descriptor: str, description: DescriptorOptions
) -> Callable[[PreparedImage, Features], Features]:
    def describe_one(prepared: PreparedImage, features: Features) -> Features:
        return describe(descriptor, prepared, features, description)

    return describe_one


def time_features(
    detector: str, images: StudyImages, options: CompareOptions, pool: ThreadPoolExecutor
) -> tuple[list[Features], DetectorSpeed]:
    """Regions of all images; the time includes scale space, detection and SIFT."""
    detection = options.detection
    sizes = [(p.shape[1], p.shape[0]) for p in images.pixels]
    where = images.folder / "images", images.names, sizes, detection
    masks = images.folder / "masks"
    mask_path = masks if masks.is_dir() else None
    if detector in COLMAP_DETECTORS:
        begin = time.perf_counter()
        features = colmap_features(detector, *where, mask_path=mask_path)
        seconds = time.perf_counter() - begin
    else:

        def both(pixels: Array, mask: Bool | None, external: dict[str, Regions]) -> Features:
            prepared = prepare(pixels, mask, detection)
            found = detect(detector, prepared, detection, external=external)
            return describe("sift", prepared, found, options.description)

        # once beforehand on a corner: compiled code is loaded, not timed
        nowhere = circular_regions(np.zeros((0, 2)), np.zeros(0), np.zeros(0), 0)
        both(images.pixels[0][:64, :64], None, dict.fromkeys(external_parts(detector), nowhere))
        begin = time.perf_counter()
        external = colmap_regions(detector, *where, mask_path=mask_path)
        features = list(pool.map(both, images.pixels, images.masks, external))
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
