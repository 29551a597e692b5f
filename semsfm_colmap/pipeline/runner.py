"""The stages in order, each skipped when its inputs, options and outputs are unchanged."""

from __future__ import annotations

import shlex
import time
from collections.abc import Sequence
from contextlib import nullcontext, suppress
from dataclasses import dataclass, replace
from pathlib import Path

from semsfm_colmap.config import (
    Config,
    config_to_dict,
    read_config,
    without_executor,
    write_config,
)
from semsfm_colmap.errors import (
    ClusterError,
    DiskFullError,
    InputError,
    MissingDependencyError,
    SemSfmError,
    UsageError,
)
from semsfm_colmap.io.disk import full_disk_is_said, sync
from semsfm_colmap.io.temporary import remove_leftovers
from semsfm_colmap.pipeline.executor import Executor, open_executor
from semsfm_colmap.pipeline.fingerprint import content
from semsfm_colmap.pipeline.keys import stage_key, standing_key
from semsfm_colmap.pipeline.outputs import (
    OutputCheck,
    check_outputs,
    command_of,
    fingerprints,
    keep_changed,
)
from semsfm_colmap.pipeline.project import Project, check_output, locked, open_project
from semsfm_colmap.pipeline.project_options import read_project_options
from semsfm_colmap.pipeline.record import (
    RunRecord,
    StageEntry,
    hash_text,
    peak_memory_mb,
)
from semsfm_colmap.pipeline.registry import STAGE_NAMES, STAGES, find_stage, stages_after
from semsfm_colmap.pipeline.reporter import Reporter
from semsfm_colmap.pipeline.sources import check_same_series, input_hashes, source_key
from semsfm_colmap.pipeline.stage import Stage, StageRun
from semsfm_colmap.records import StageRecord, to_plain

STAGE_FORMAT = "4"
"""Raise it when a stage's results change for unchanged options: old projects are recomputed."""


def run_stages(
    project_path: Path | str,
    config: Config,
    *,
    names: Sequence[str] = STAGE_NAMES,
    image_path: Path | str | None = None,
    reporter: Reporter | None = None,
    executor: Executor | None = None,
    force: bool = False,
) -> RunRecord:
    """Run some stages of a project, in order.

    Parameters
    ----------
    project_path : the project folder
    config : all options
    names : stages to run; those before them must have run
    image_path : folder of the source images, or an MRC stack; needed for the stage that makes the
        project
    reporter : told how far it is, and what to note; default: nothing is said
    executor : how work on single images and pairs is spread; default: as the options say
    force : run them even when nothing has changed

    Returns
    -------
    the content of run.json

    Raises
    ------
    InputError
        The data do not allow a stage; one sentence says why and what to try.
    UsageError
        There are no such images, project or stage, or another process works on the project.

    """
    reporter = reporter or Reporter(verbosity=-1)
    project = open_project(project_path, new=True)
    if not (config.executor == "local" if executor is None else executor.shares_memory):
        # other processes may have been started in another folder
        project = Project(project.path.resolve())
    chosen = [find_stage(name) for name in names]
    check_output(project, [place for stage in STAGES for place in stage.places])
    source = None if image_path is None else Path(image_path)
    if source is not None:
        if not source.exists():
            raise UsageError(f"{source} does not exist: give the folder with the images")
    elif any(stage.founds for stage in chosen):
        raise UsageError(f"the {STAGE_NAMES[0]} stage needs the folder with the images")
    elif not project.series.is_file():
        raise UsageError(
            f"{project.path} is not a semsfm project: run `semsfm extract IMAGES --output_path "
            f"{shlex.quote(str(project.path))}` first"
        )
    with locked(project), full_disk_is_said(project.path):
        remove_leftovers(project.path)
        # another process may have written it until now
        record = RunRecord.read(project.record)
        if source is not None:
            inputs = input_hashes(source, record.inputs, config.ingest, project.path)
            check_same_series(project, record, source, inputs, reporter, force=force)
            record.image_path = str(source.resolve())
            record.inputs = inputs
        record.seed = config.seed
        try:
            with (
                open_executor(config, project.path, reporter.say)
                if executor is None
                else nullcontext(executor)
            ) as workers:
                Runner(
                    project=project,
                    config=config,
                    record=record,
                    reporter=reporter,
                    executor=workers,
                    force=force,
                ).run({stage.name for stage in chosen})
        finally:
            reporter.close()
    return record


@dataclass(frozen=True, kw_only=True, eq=False)
class Runner:
    """One call of `run_stages` on a project that it holds."""

    project: Project
    config: Config
    record: RunRecord
    reporter: Reporter
    executor: Executor
    force: bool

    def run(self, names: set[str]) -> None:
        """Go through all stages; run those named that are not up to date."""
        key = source_key(self.record, STAGE_FORMAT)
        before = RunRecord.read(self.project.record)
        anything, nothing_of = False, ""
        database_anew = False
        for stage in STAGES:
            key = stage_key(stage, key, self.project, self.config)
            entry = self.record.entry(stage.name)
            check = check_outputs(stage, self.project, entry.outputs)
            if stage.name not in names:
                self.check_standing(stage, names, check)
                key = standing_key(entry, key)
                if check.differ:
                    key = hash_text(key, *map(content, check.found.values()))
            elif self.record.is_done(stage.name, key) and not check.differ and not self.force:
                self.reporter.say(f"{stage.name}: up to date")
                known = check.found or fingerprints(stage, self.project, {})
                self.record.stages[stage.name] = replace(entry, outputs=known)
                key = entry.for_later_stages
            else:
                if not anything:
                    self.check_libraries(names)
                    anything = True
                if nothing_of and stage.optional:
                    # what an earlier run has left of that stage is of another model
                    error = InputError(f"not made, because {nothing_of} came to nothing")
                    self.reporter.warn(f"{stage.name}: {error}")
                    self.keep(stage, failed(stage, 0.0, error))
                    continue
                heard = check.without_database if database_anew else check
                database_anew |= stage.database_part is not None
                if self.perform(stage, key, heard, wanted=wanted(stage, names)):
                    key = self.record.entry(stage.name).for_later_stages
                else:
                    nothing_of = stage.name
        if before != self.record:
            # stamps that have settled since: what was not touched is not read again next time
            self.record.write()
        self.keep_options()

    def check_libraries(self, names: set[str]) -> None:
        """Say now what a stage would find out after an hour."""
        from semsfm_colmap.io.open3d_library import import_open3d

        for stage in map(find_stage, names):
            if stage.needs_open3d:
                try:
                    import_open3d()
                except MissingDependencyError as error:
                    if wanted(stage, names):
                        raise
                    self.reporter.warn(
                        f"{stage.name} will come to nothing, all else is made: {error}"
                    )

    def check_standing(self, stage: Stage, names: set[str], check: OutputCheck) -> None:
        """Refuse to run later stages on results that are not there, and say where they are others.

        A person may have changed them on purpose: they are taken as they stand.
        """
        if names.isdisjoint(stages_after(stage.name)) or not check.differ:
            return
        command = command_of(stage, self.project, self.record)
        if check.gone and not stage.optional:
            gone = replace(check, changed=())
            raise InputError(f"{self.project.path}: {gone.says}: run `{command}` first")
        if self.record.entry(stage.name).status == "done":
            self.reporter.warn(
                f"{stage.name}: {check.says}, and used so: `{command}` makes them as they were"
            )

    def perform(self, stage: Stage, key: str, check: OutputCheck, *, wanted: bool) -> bool:
        """Run a stage and keep what it says; False when an optional one has failed.

        Parameters
        ----------
        check : of what an earlier run has left
        wanted : the run is about this stage: without it there is nothing

        """
        begin = time.monotonic()
        entry = self.record.entry(stage.name)
        if entry.key == key and entry.status == "done" and check.differ and not self.force:
            self.reporter.warn(f"{stage.name}: {check.says}: made again")
        for kept in keep_changed(self.project, check.changed):
            self.reporter.warn(kept)
        # a run with the same key that was cut off goes on; anything else starts afresh
        fresh = self.force or entry.key != key or entry.status == "done"
        if stage.database_part is not None and not fresh and self.project.database.is_file():
            from semsfm_colmap.colmap.database.content import is_sound

            fresh = not is_sound(self.project.database)
        if not stage.founds:
            self.reporter.log_to(self.project.log)
            self.keep(stage, StageEntry(status="running", key=key))
        try:
            result = stage.run(
                StageRun(
                    project=self.project,
                    config=self.config,
                    reporter=self.reporter,
                    record=self.record,
                    executor=self.executor,
                    fresh=fresh,
                )
            )
        except (ClusterError, DiskFullError):
            raise  # as after a kill: the same command goes on
        except SemSfmError as error:
            if not stage.founds:
                self.keep(stage, failed(stage, time.monotonic() - begin, error))
            if wanted:
                raise
            self.reporter.warn(f"{stage.name}: {error}")
            return False
        if stage.database_part is not None:
            sync(self.project.database)  # COLMAP leaves that to the system
        entry = StageEntry.done(key, time.monotonic() - begin, result)
        if stage.product is not None:
            entry = replace(entry, product=stage.product(self.project))
        entry = replace(entry, outputs=fingerprints(stage, self.project, check.found))
        self.reporter.log_to(self.project.log)
        self.record.options = config_to_dict(without_executor(self.config))
        self.keep(stage, entry)
        self.keep_options()
        return True

    def keep_options(self) -> None:
        """Write semsfm.toml where it holds anything else, or nothing."""
        with suppress(UsageError):
            if read_config(self.project.config) == without_executor(self.config):
                return
        write_config(without_executor(self.config), self.project.config)

    def keep(self, stage: Stage, entry: StageEntry) -> None:
        """Put the entry of a stage into run.json."""
        self.record.stages[stage.name] = entry
        self.record.write()


def wanted(stage: Stage, names: set[str]) -> bool:
    """Whether the run is in vain without the stage: one that is optional, where it comes last."""
    needs = {name for name in names if not find_stage(name).optional}
    return not stage.optional or needs.isdisjoint(stages_after(stage.name))


def failed(stage: Stage, seconds: float, error: SemSfmError) -> StageEntry:
    """The entry of a stage that could not be done."""
    return StageEntry(
        status="failed",
        seconds=seconds,
        peak_memory_mb=peak_memory_mb(),
        summary=to_plain(StageRecord(notes=(f"{stage.name}: {error}",))),
    )


def reconstruct(
    image_path: Path | str,
    output_path: Path | str,
    config: Config | None = None,
    *,
    reporter: Reporter | None = None,
) -> RunRecord:
    """A folder of SEM images becomes a COLMAP project, a mesh and a report.

    Parameters
    ----------
    image_path : folder of PNG, JPEG or TIFF images of one specimen, tilted or rotated, or an MRC
        stack of them
    output_path : the project folder, see docs/files.md; unchanged stages of an earlier run are kept
    config : all options; default: those that the project was made with, of a new one `Config`
    reporter : told how far it is, and what to note; default: nothing is said

    Returns
    -------
    the content of run.json

    Raises
    ------
    InputError
        The data do not allow it; one sentence says why and what to try.
    UsageError
        A path is none of what is asked for, or the project is in use.

    """
    config = config or read_project_options(Project(Path(output_path)), reporter=reporter)
    return run_stages(
        Path(output_path), config or Config(), image_path=Path(image_path), reporter=reporter
    )
