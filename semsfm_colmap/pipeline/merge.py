"""`semsfm merge`: several series of one specimen become one project.

The prepared images and masks of the projects are copied under names with the series in front.
Keypoints are found anew, turned to their dominant gradient: those of a project are upright where
that serves its own series, and an upright keypoint is not found again in an image that was taken
with the specimen turned in the image plane. From there on the merged folder is an ordinary project.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from semsfm_colmap.config import Config
from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.ingest.files.stale import remove_stale
from semsfm_colmap.ingest.series.file import (
    PreparationRecord,
    read_preparation,
    read_written_files,
    write_series,
)
from semsfm_colmap.io.atomic import write_bytes
from semsfm_colmap.pipeline.outputs import fingerprints
from semsfm_colmap.pipeline.project import Project, check_output, locked, open_project
from semsfm_colmap.pipeline.record import RunRecord, StageEntry, hash_file, hash_text
from semsfm_colmap.pipeline.registry import STAGES, find_stage
from semsfm_colmap.pipeline.reporter import Reporter
from semsfm_colmap.pipeline.runner import run_stages
from semsfm_colmap.pipeline.stages.ingest import pixels
from semsfm_colmap.records import IngestRecord, MatchRecord
from semsfm_colmap.types import SemFrame, SemSeries

TILT_NOTE = (
    "recorded tilts are not used in a merged model: each series has an axis of its own, and what "
    "lies between them no stage has recorded"
)

PIXEL_SIZE_NOTE = (
    "the first series has no pixel size, so that lengths are in its px: name a series first that "
    "has one"
)


def merge_projects(
    project_paths: Sequence[Path | str],
    output_path: Path | str,
    config: Config | None = None,
    *,
    reporter: Reporter | None = None,
    force: bool = False,
) -> RunRecord:
    """Several projects of one specimen become one, mapped together.

    Parameters
    ----------
    project_paths : two projects or more, whose images are prepared; they are only read
    output_path : the new project folder
    config : all options; features are turned to their gradients unless `features.upright` is set
    reporter : told how far it is, and what to note; default: nothing is said
    force : run every stage even when nothing has changed

    Returns
    -------
    the content of run.json

    Raises
    ------
    InputError
        A project is none, or the series have nothing in common; one sentence.
    UsageError
        Fewer than two projects, one named twice, or `output_path` is one of them.

    """
    config, reporter = config or Config(), reporter or Reporter(verbosity=-1)
    if config.features.upright is None:
        config = replace(config, features=replace(config.features, upright=False))
    sources = [open_project(path, new=True) for path in project_paths]
    project = open_project(output_path, new=True)
    check_sources(sources, project)
    check_output(project, [place for stage in STAGES for place in stage.places])
    with locked(project):
        check_replaced(project, force=force)
        series = copy_series(sources, project, config, reporter)
    names = ("extract", "match")
    record = run_stages(project.path, config, names=names, reporter=reporter, force=force)
    check_crossing(record, series)
    return run_stages(project.path, config, names=("map",), reporter=reporter, force=force)


def check_sources(sources: Sequence[Project], project: Project) -> None:
    """Refuse what are not several projects, and an output among them."""
    if len(sources) < 2:
        raise UsageError("merging takes two projects or more: give their folders")
    paths = [source.path.resolve() for source in sources]
    if len(set(paths)) < len(paths):
        raise UsageError("a project is named twice: give each series once")
    if project.path.resolve() in paths:
        raise UsageError(f"{project.path} is one of the projects: give another --output_path")
    for source in sources:
        if not source.series.is_file():
            raise InputError(
                f"{source.path} is not a semsfm project: run `semsfm reconstruct` on its images "
                "first"
            )


def check_replaced(project: Project, *, force: bool) -> None:
    """Refuse to put a merged series in the place of the one that a project was made from."""
    made_from = RunRecord.read(project.record).image_path
    if made_from and not force:
        raise UsageError(
            f"{project.path} was made from the images of {made_from}: give another --output_path, "
            "or --force to replace all of it"
        )


def series_labels(paths: Sequence[Path]) -> list[str]:
    """A name for each series: that of its folder, with a number where two are alike."""
    labels: list[str] = []
    for path in paths:
        name = path.resolve().name
        count = 1
        while (label := name if count == 1 else f"{name}{count}") in labels:
            count += 1
        labels.append(label)
    return labels


def copy_series(
    sources: Sequence[Project], project: Project, config: Config, reporter: Reporter
) -> SemSeries:
    """Images, masks and series.json of the merged project, in the place of the ingest stage."""
    begin = time.monotonic()
    record = RunRecord.read(project.record)
    written = read_written_files(project.series)
    frames: list[SemFrame] = []
    warnings: list[str] = []
    joined = PreparationRecord.of(config.ingest)
    all_series = [source.read_series() for source in sources]
    for source, label, series in zip(
        sources, series_labels([s.path for s in sources]), all_series, strict=True
    ):
        kept = read_preparation(source.series)
        for frame in series.frames:
            name = merged_name(label, frame.name)
            copy_file(source.images / frame.name, project.images / name)
            metadata = replace(frame.metadata, pixel_size_um=series.pixel_size_um)
            frames.append(replace(frame, name=name, series=label, metadata=metadata))
        for mask in kept.masks:
            copy_file(source.masks / mask, project.masks / merged_name(label, mask))
        joined.masks += [merged_name(label, mask) for mask in kept.masks]
        for joint, own in (
            (joined.grey_range, kept.grey_range),
            (joined.mask_effect, kept.mask_effect),
        ):
            joint.update({merged_name(label, name): values for name, values in own.items()})
        warnings += [f"{label}: {warning}" for warning in series.warnings]
    if len({frame.name for frame in frames}) < len(frames):
        raise InputError("two images would get the same name: rename the folder of a project")
    sizes = [series.pixel_size_um for series in all_series]
    if sizes[0] is None and any(sizes):
        warnings.append(PIXEL_SIZE_NOTE)
    if any(frame.metadata.tilt_rad is not None for frame in frames):
        warnings.append(TILT_NOTE)
    merged = SemSeries(
        frames=tuple(frames),
        pixel_size_um=all_series[0].pixel_size_um,
        pixel_size_source=all_series[0].pixel_size_source,
        warnings=tuple(warnings),
    )
    write_series(merged, project.series, record=joined)
    remove_stale(project.images, written.images, set(merged.names))
    remove_stale(project.masks, written.masks, set(joined.masks))
    key = hash_text("merge", *(hash_file(source.series) for source in sources))
    entry = StageEntry.done(
        key,
        time.monotonic() - begin,
        IngestRecord(
            num_images=len(frames), pixel_size_um=merged.pixel_size_um, warnings=merged.warnings
        ),
        product=pixels(project),
    )
    left = fingerprints(find_stage("ingest"), project, {})
    record.image_path, record.inputs = "", {}
    record.stages["ingest"] = replace(entry, outputs=left)
    record.write()
    reporter.say(f"{len(frames)} images of {len(sources)} series: {', '.join(merged.series_names)}")
    return merged


def merged_name(label: str, name: str) -> str:
    """Name of an image or a mask in the merged project, in one folder whatever it was in."""
    return f"{label}_{name.replace('/', '_')}"


def copy_file(source: Path, target: Path) -> None:
    """Copy whole or not at all."""
    try:
        content = source.read_bytes()
    except OSError as error:
        raise InputError(
            f"{source} cannot be read ({error.strerror}): prepare the images of that "
            f"project again: `semsfm extract IMAGES --output_path PROJECT`"
        ) from error
    write_bytes(content, target)


def check_crossing(record: RunRecord, series: SemSeries) -> None:
    """Refuse series between which no pair of images was verified."""
    matched = record.result("match", MatchRecord)
    assert matched is not None
    of = {frame.name: frame.series for frame in series.frames}
    tied = {
        frozenset((of[p.image_name_1], of[p.image_name_2]))
        for p in matched.pairs
        if p.failure is None
    }
    reached = {series.series_names[0]}
    while more := {name for pair in tied if pair & reached for name in pair} - reached:
        reached |= more
    apart = [name for name in series.series_names if name not in reached]
    if apart:
        raise InputError(
            f"no image of {' or '.join(apart)} matches one of {', '.join(sorted(reached))}: the "
            "series show different specimens, or sides that have nothing in common; nothing was "
            "merged"
        )
