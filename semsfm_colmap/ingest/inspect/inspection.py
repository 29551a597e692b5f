"""Look at a series without preparing it: a row per image, and a verdict on the whole."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from semsfm_colmap.errors import InputError
from semsfm_colmap.ingest.files.bit_depth import to_grey8
from semsfm_colmap.ingest.files.header import UnreadableImageError
from semsfm_colmap.ingest.files.listing import find_images
from semsfm_colmap.ingest.frame.quality import FrameQuality, judge, measure
from semsfm_colmap.ingest.frame.source import SourceImage, check_content, scan_image
from semsfm_colmap.ingest.inspect.answers import Answer, answer_all
from semsfm_colmap.ingest.inspect.neighbours import drifted, misplaced, strangers
from semsfm_colmap.ingest.inspect.overlap import (
    Overlap,
    ReducedFeatures,
    chain,
    find_overlap,
    reduced_features,
)
from semsfm_colmap.ingest.inspect.rows import InspectionRow, row_of, unusable_row
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.ingest.series.copies import View, leave_out_copies, view_of
from semsfm_colmap.ingest.series.crops import choose_crops
from semsfm_colmap.ingest.series.overrides import apply_scale_bars, apply_tables
from semsfm_colmap.ingest.series.pixel_size import series_pixel_size
from semsfm_colmap.ingest.series.refusals import check_options, no_images_message
from semsfm_colmap.ingest.series.remarks import series_warnings
from semsfm_colmap.types import SemFrame


@dataclass(frozen=True, kw_only=True)
class Inspection:
    """Rows in natural order of the names, answers about the series, and other remarks."""

    rows: tuple[InspectionRow, ...]
    answers: tuple[Answer, ...]
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True, eq=False)
class _Look:
    """One usable image with what was measured on its pixels."""

    image: SourceImage
    quality: FrameQuality
    features: ReducedFeatures
    view: View


def inspect_images(
    image_path: Path,
    options: IngestOptions,
    *,
    progress: Callable[[int, int], None] | None = None,
) -> Inspection:
    """Read every image below `image_path`, compare neighbours, judge the series."""
    image_path = Path(image_path)
    check_options(options)
    found = find_images(image_path)
    if not found.names:
        raise InputError(no_images_message(image_path, found.warnings))
    rows: dict[str, InspectionRow] = {}
    looks: list[_Look] = []
    for count, name in enumerate(found.names):
        try:
            looks.append(_look_at(image_path / name, name, options))
        except UnreadableImageError as error:
            rows[name] = unusable_row(image_path / name, name, str(error), options)
        if progress:
            progress(count + 1, len(found.names))
    remarks = list(found.warnings)
    kept, problems, repeated = _settle(looks, options)
    remarks += repeated
    for name in {look.image.name for look in looks} - {look.image.name for look in kept}:
        why = next(problem for problem in problems if problem.startswith(f"{name}: "))
        problems.remove(why)
        reason = why.removeprefix(f"{name}: ").removesuffix(" Left out.")
        rows[name] = unusable_row(image_path / name, name, reason, options)
    looks, remarks = kept, remarks + problems
    overlaps = chain([look.features for look in looks])
    notes = _notes(looks, overlaps)
    for look in looks:
        rows[look.image.name] = row_of(look.image, options, notes[look.image.name])
    used = [rows[look.image.name] for look in looks]
    answers = answer_all(
        names=[row.name for row in used],
        side_px=[_side(look.image) for look in looks],
        tilt_deg=[row.tilt_deg for row in used],
        rotation_deg=[row.stage_rotation_deg for row in used],
        pixel_size_um=[row.pixel_size_um for row in used],
        overlaps=overlaps,
        far_overlaps=_far_overlaps([look.features for look in looks]),
    )
    return Inspection(
        rows=tuple(rows[name] for name in found.names if name in rows),
        answers=(*answers, _flagged(used)),
        remarks=(*remarks, *_series_remarks([look.image for look in looks], options)),
    )


def _series_remarks(images: list[SourceImage], options: IngestOptions) -> list[str]:
    """What `prepare_series` says of the series as a whole."""
    frames = [
        SemFrame(
            name=image.name,
            width_px=image.size[0],
            height_px=image.size[1],
            source_path=str(image.path),
            crop_px=image.crop,
            metadata=image.reading.metadata,
        )
        for image in images
    ]
    if not frames:
        return []
    return [*series_pixel_size(frames, options.pixel_size_um).warnings, *series_warnings(frames)]


def _look_at(path: Path, name: str, options: IngestOptions) -> _Look:
    image, raw = scan_image(path, name, options)
    x0, y0, x1, y1 = options.crop or image.crop
    cropped = raw.pixels[y0:y1, x0:x1]
    if cropped.size:
        check_content(cropped)
    grey, _ = to_grey8(cropped if cropped.size else raw.pixels, options.range_percentiles)
    grey = np.asarray(grey)
    return _Look(
        image=image,
        quality=measure(grey),
        features=reduced_features(grey),
        view=view_of(image, raw),
    )


def _settle(looks: list[_Look], options: IngestOptions) -> tuple[list[_Look], list[str], list[str]]:
    """Leave out copies; apply table, scale bar and the common crop, as `prepare_series` does.

    Also sentences about images left out, and about views that come again.
    """
    keep, copies, repeated = leave_out_copies(
        [look.image for look in looks], [look.view for look in looks]
    )
    images, problems = choose_crops([looks[k].image for k in keep], options)
    problems = [*copies, *problems]
    images, more = apply_scale_bars(images, options)
    problems += more
    images, more = apply_tables(images, options)
    problems += more
    by_name = {image.name: image for image in images}
    kept = [
        replace(look, image=by_name[look.image.name])
        for look in looks
        if look.image.name in by_name
    ]
    return kept, problems, repeated


def _notes(looks: list[_Look], overlaps: list[Overlap]) -> dict[str, list[str]]:
    """Remarks per frame from comparing it with the others."""
    names = [look.image.name for look in looks]
    notes: dict[str, list[str]] = {name: [] for name in names}
    features = [look.features for look in looks]
    foreign = strangers(names, features, overlaps)
    for name in foreign:
        notes[name].append("shares no features with its neighbours: another specimen or view?")
    if any(overlap.overlapping for overlap in overlaps):  # else they are no neighbours
        familiar = [look for look in looks if look.image.name not in foreign]
        for look, said in zip(familiar, judge([x.quality for x in familiar]), strict=True):
            notes[look.image.name] += said
    astray = misplaced(names, features, overlaps)
    for name in astray:
        notes[name].append("out of order: its neighbours are closer to one another than to it")
    for name, note in drifted(names, [_side(look.image) for look in looks], overlaps).items():
        if name not in astray:  # else it is sheared by its other angle
            notes[name].append(note)
    for look in looks:
        if not look.image.reading.vendor and look.image.reading.metadata.pixel_size_um is None:
            notes[look.image.name].append("no microscope header")
    return notes


def _far_overlaps(features: list[ReducedFeatures]) -> list[Overlap]:
    """Overlaps over longer distances, where more parallax shows."""
    count = len(features)
    distances = sorted({d for d in (2, 4, count // 4, count // 2) if 1 < d < count})
    return [find_overlap(features[0], features[d]) for d in distances]


def _flagged(rows: list[InspectionRow]) -> Answer:
    words = ("blurred", "charged", "drifted", "moved", "out of order", "brightness", "shares no")
    flagged = [row for row in rows if any(w.startswith(words) for w in row.warnings)]
    if not rows:
        return Answer(question="frames in order", answer="unknown", reason="no image is usable")
    if not flagged:
        return Answer(question="frames in order", answer="yes", reason="none looks charged, "
                      "blurred or drifted")  # fmt: skip
    said = [
        f"{row.name} ({next(w for w in row.warnings if w.startswith(words))})"
        for row in flagged[:5]
    ]
    more = f" and {len(flagged) - 5} more" if len(flagged) > 5 else ""
    return Answer(question="frames in order", answer="no", reason="; ".join(said) + more)


def _side(image: SourceImage) -> float:
    return float(max(image.crop[2] - image.crop[0], image.crop[3] - image.crop[1]))
