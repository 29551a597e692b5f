"""`semsfm reconstruct --database_path`: another's features and matches in a project of ours.

The stages extract and match are replaced by a copy: keypoints, descriptors and raw matches as they
are, two-view geometries verified again with the affine model. Everything after is as always.

The images of a project lack the databar and may be cropped. A database may have been made from
either the source images or the prepared ones; which, is seen from the sizes of its cameras, and
keypoints of source images are shifted with the crop. Those that lie outside it keep their numbers
and lose their matches.
"""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from semsfm_colmap.config import Config, options_key
from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.io.names import name_keys
from semsfm_colmap.pipeline.executor import ThreadExecutor
from semsfm_colmap.pipeline.foreign.map_database import (
    PAIRS_IN_MEMORY,
    size_on_disk,
    verify_database,
)
from semsfm_colmap.pipeline.outputs import check_outputs, database_name, fingerprints
from semsfm_colmap.pipeline.project import Project, locked, open_project
from semsfm_colmap.pipeline.record import RunRecord, StageEntry, hash_file, hash_text
from semsfm_colmap.pipeline.registry import find_stage, stages_after
from semsfm_colmap.pipeline.reporter import Reporter
from semsfm_colmap.pipeline.runner import run_stages
from semsfm_colmap.records import ExtractRecord, MatchRecord, PairStatistics
from semsfm_colmap.types import Array, Float, SemFrame, SemSeries

if TYPE_CHECKING:
    from semsfm_colmap.colmap.database.reader import DatabaseReader, StoredImage

LAST_REPLACED = "match"
"""The stages up to this one are run or replaced here; the others follow."""


def reconstruct_from_database(
    image_path: Path | str,
    database_path: Path | str,
    output_path: Path | str,
    config: Config | None = None,
    *,
    reporter: Reporter | None = None,
    force: bool = False,
) -> RunRecord:
    """As `reconstruct`, with the features and matches of a COLMAP database.

    Parameters
    ----------
    image_path : folder of the images, all of which the database must know
    database_path : COLMAP database of the 3.8 or 4.x schema; not changed
    output_path : the project folder
    config : all options; those of features and matching hold for verification alone
    reporter : told how far it is, and what to note; default: nothing is said
    force : run every stage even when nothing has changed

    Returns
    -------
    the content of run.json

    Raises
    ------
    InputError
        The database does not fit the images, or the data do not allow a stage; one sentence.
    UsageError
        A path is none of what is asked for.

    """
    config, reporter = config or Config(), reporter or Reporter(verbosity=-1)
    project = open_project(output_path, new=True)
    image_path, database_path = Path(image_path), Path(database_path)
    if database_path.exists() and database_path.resolve() == project.database.resolve():
        raise UsageError(
            f"{database_path} is the project's own database: leave --database_path away"
        )
    key = hash_database(database_path)
    run_stages(
        project.path,
        config,
        names=("ingest",),
        image_path=image_path,
        reporter=reporter,
        force=force,
    )
    with locked(project):
        try:
            import_database(project, image_path, database_path, key, config, reporter, force=force)
        finally:
            reporter.close()
    return run_stages(
        project.path, config, names=stages_after(LAST_REPLACED), reporter=reporter, force=force
    )


def hash_database(path: Path) -> str:
    """A key of the content, what is not yet folded into the main file included."""
    from semsfm_colmap.colmap.database.checks import check_file

    check_file(path)
    log = path.with_name(path.name + "-wal")
    return hash_text(hash_file(path), hash_file(log) if log.is_file() else "")


def import_database(
    project: Project,
    image_path: Path,
    database_path: Path,
    database_key: str,
    config: Config,
    reporter: Reporter,
    *,
    force: bool,
) -> None:
    """Fill the project's database from another, unless that is done; both stages in run.json."""
    from semsfm_colmap.colmap.database.reader import read_database
    from semsfm_colmap.colmap.database.scratch import database_aside

    record = RunRecord.read(project.record)
    ingested = record.entry("ingest").for_later_stages
    key = hash_text("import", ingested, database_key)
    match_key = hash_text(key, str(config.seed), options_key(config.matching))
    done = record.is_done("extract", key) and record.is_done("match", match_key)
    checks = [
        check_outputs(find_stage(name), project, record.entry(name).outputs)
        for name in ("extract", "match")
    ]
    if done and not force:
        if not any(check.differ for check in checks):
            reporter.say("extract, match: up to date")
            return
        reporter.warn(f"{project.database} is not as it was left: filled again from the database")
    reporter.log_to(project.log)
    for name, stage_key in (("extract", key), ("match", match_key)):
        record.stages[name] = StageEntry(status="running", key=stage_key)
    record.write()
    series = project.read_series()
    with database_aside(project.database) as aside, read_database(database_path) as reader:
        images = find_images(reader, series, image_path)
        begin = time.monotonic()
        usable_xy, extracted = copy_features(reader, images, series, aside, reporter)
        record.stages["extract"] = StageEntry.done(key, time.monotonic() - begin, extracted)
        begin = time.monotonic()
        ids = [image.image_id for image in images]
        matched = copy_matches(reader, ids, usable_xy, series, aside, config, reporter)
        record.stages["match"] = StageEntry.done(match_key, time.monotonic() - begin, matched)
    for name in ("extract", "match"):
        left = fingerprints(find_stage(name), project, {})
        record.stages[name] = replace(record.stages[name], outputs=left)
    for stage in map(find_stage, stages_after(LAST_REPLACED)):
        # what it had added to the database went with it
        if stage.database_part is not None and stage.name in record.stages:
            entry = record.stages[stage.name]
            kept = {k: v for k, v in entry.outputs.items() if k != database_name(stage)}
            record.stages[stage.name] = replace(entry, status="stale", key="", outputs=kept)
    record.write()


def copy_features(
    reader: DatabaseReader,
    images: Sequence[StoredImage],
    series: SemSeries,
    target: Path,
    reporter: Reporter,
) -> tuple[list[Float], ExtractRecord]:
    """Keypoints and descriptors, image by image; positions with nan outside the prepared image."""
    from semsfm_colmap.colmap.database.images import register_images
    from semsfm_colmap.colmap.database.work import write_features

    sizes = [(frame.width_px, frame.height_px) for frame in series.frames]
    shifts = [
        crop_shift(frame, image, reader.path)
        for frame, image in zip(series.frames, images, strict=True)
    ]
    register_images(target, series.names, sizes)
    usable_xy: list[Float] = []
    with reporter.progress("features") as progress:
        for k, (image, size, shift) in enumerate(zip(images, sizes, shifts, strict=True), start=1):
            keypoints = np.array(reader.keypoints(image.image_id))
            keypoints[:, :2] -= np.asarray(shift, dtype=np.float32)
            usable_xy.append(inside_only(keypoints, size))
            # a keypoint without a place keeps its number; it has no matches from here on
            finite = np.nan_to_num(keypoints, posinf=0.0, neginf=0.0)
            write_features(target, k, finite, reader.descriptors(image.image_id))
            progress(k, len(images))
    counts = [len(xy) for xy in usable_xy]
    reporter.say(f"features: {sum(counts)} keypoints of {reader.path}")
    return usable_xy, ExtractRecord(
        num_keypoints=dict(zip(series.names, counts, strict=True)),
        notes=(f"features and matches are those of {reader.path}",),
    )


def copy_matches(
    reader: DatabaseReader,
    source_ids: Sequence[int],
    usable_xy: Sequence[Float],
    series: SemSeries,
    target: Path,
    config: Config,
    reporter: Reporter,
) -> MatchRecord:
    """Raw matches as they are, and two-view geometries from their affine verification."""
    from semsfm_colmap.colmap.database.match_steps import stored_steps, write_match_steps
    from semsfm_colmap.colmap.database.two_view import stored_geometry
    from semsfm_colmap.colmap.database.work import write_matches, write_two_view_geometries
    from semsfm_colmap.matching.statistics import pair_statistics

    ids = range(1, len(source_ids) + 1)
    raw, verified = {}, {}
    statistics: list[PairStatistics] = []
    steps: list[tuple[tuple[int, int], Array]] = []
    executor = ThreadExecutor(config.num_threads)
    for geometry in verify_database(reader, source_ids, usable_xy, config, reporter, executor):
        i, j = geometry.image_pair
        raw[ids[i], ids[j]] = geometry.keypoints
        pair, stored = stored_geometry(geometry, ids)
        verified[pair] = stored
        statistics += pair_statistics([geometry], series.names)
        steps += stored_steps([geometry], ids)
        if len(raw) == PAIRS_IN_MEMORY:
            write_matches(target, raw)
            raw.clear()
    write_matches(target, raw)
    write_two_view_geometries(target, verified)
    write_match_steps(target, steps)
    return MatchRecord(
        num_pairs=len(statistics),
        num_verified_pairs=sum(F is not None for F, _ in verified.values()),
        pairs=tuple(statistics),
    )


def find_images(reader: DatabaseReader, series: SemSeries, image_path: Path) -> list[StoredImage]:
    """The database's image of each frame, by the closest of `name_keys` that tells them apart.

    The prepared image of a frame may have another suffix than its source, and a database may have
    been made from a folder above or below.
    """
    stored = reader.images()
    keys: list[dict[str, list[StoredImage]]] = [{}, {}, {}, {}]
    for image in stored:
        for names, key in zip(keys, name_keys(image.name), strict=True):
            names.setdefault(key, []).append(image)
    found: list[StoredImage] = []
    for frame in series.frames:
        source = _below(Path(frame.source_path), image_path)
        match = None
        for level, names in enumerate(keys):
            for name in (frame.name, source):
                candidates = names.get(name_keys(name)[level], [])
                if match is None and len(candidates) == 1 and candidates[0] not in found:
                    match = candidates[0]
        if match is None:
            raise InputError(
                f"{reader.path} does not name {source} (of its {len(stored)} images the first is "
                f"{stored[0].name if stored else 'nothing'}): give the database that was made from "
                f"the images in {image_path}"
            )
        found.append(match)
    return found


def _below(path: Path, folder: Path) -> str:
    """A path from a folder on; its name alone where no way leads there, as between two drives."""
    try:
        return Path(os.path.relpath(path, folder)).as_posix()
    except ValueError:
        return path.name


def crop_shift(frame: SemFrame, image: StoredImage, database_path: Path) -> tuple[int, int]:
    """What to subtract from keypoints: the crop's corner, or nothing where that was done before."""
    size = (image.width_px, image.height_px)
    if size == (frame.width_px, frame.height_px):
        return 0, 0
    source = size_on_disk(Path(frame.source_path), database_path)
    if size == source:
        return frame.crop_px[0], frame.crop_px[1]
    raise InputError(
        f"{frame.source_path} is {source[0]} x {source[1]} px ({frame.width_px} x "
        f"{frame.height_px} without databar), but {database_path} was made from one of "
        f"{size[0]} x {size[1]} px: give the images it was made from"
    )


def inside_only(keypoints: Array, size: tuple[int, int]) -> Float:
    """Positions (K, 2) px of keypoints, nan where they lie outside the prepared image."""
    xy = np.asarray(keypoints[:, :2], dtype=np.float64).copy()
    inside = np.all((xy >= 0.0) & (xy <= np.asarray(size)), axis=1)
    xy[~inside] = np.nan
    return xy
