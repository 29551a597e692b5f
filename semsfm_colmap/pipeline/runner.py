"""The stages in order, each skipped when its inputs, options and outputs are unchanged."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from semsfm_colmap.config import Config, options_key, write_config
from semsfm_colmap.errors import InputError, SemSfmError, UsageError
from semsfm_colmap.pipeline.project import Project, check_output, locked
from semsfm_colmap.pipeline.record import (
    RunRecord,
    hash_file,
    hash_text,
    peak_memory_mb,
)
from semsfm_colmap.pipeline.reporter import Reporter
from semsfm_colmap.pipeline.stages import all as stages
from semsfm_colmap.pipeline.stages import surface as surface_stages

STAGE_FORMAT = "2"
"""Raise it when a stage's results change for unchanged options: old projects are recomputed."""


@dataclass(frozen=True, kw_only=True)
class Stage:
    """A stage: which options shape it, what it must leave behind, how to run it."""

    name: str
    sections: tuple[str, ...]
    outputs: Callable[[Project], Sequence[Path]]
    run: Callable[[Project, Config, Reporter, RunRecord, bool], stages.Summary]
    optional: bool = False
    """A failure is a warning, not the end: what was computed before is worth having."""


STAGES = (
    Stage(
        name="ingest",
        sections=("ingest",),
        outputs=lambda p: [p.series, p.images],
        run=lambda p, c, r, record, fresh: stages.ingest(p, Path(record.image_path), c, r),
    ),
    Stage(
        name="extract",
        sections=("features",),
        outputs=lambda p: [p.database],
        run=lambda p, c, r, record, fresh: stages.extract(p, c, r, fresh=fresh),
    ),
    Stage(
        name="match",
        sections=("matching",),
        outputs=lambda p: [p.database],
        run=lambda p, c, r, record, fresh: stages.match(p, c, r, fresh=fresh),
    ),
    Stage(
        name="map",
        sections=("tracks", "factorization", "guided", "refinement", "export"),
        outputs=lambda p: [p.sparse / "0" / "points3D.bin", p.sparse / "0" / "orthographic.json"],
        run=lambda p, c, r, record, fresh: stages.map_(p, c, r, record),
    ),
    Stage(
        name="densify",
        sections=("surface",),
        outputs=lambda p: [p.dense / "fused.ply"],
        run=lambda p, c, r, record, fresh: surface_stages.densify(p, c, r),
        optional=True,
    ),
    Stage(
        name="mesh",
        sections=("surface",),
        outputs=lambda p: [p.mesh / "mesh.ply"],
        run=lambda p, c, r, record, fresh: surface_stages.mesh(p, c, r),
        optional=True,
    ),
    Stage(
        name="report",
        sections=(),
        outputs=lambda p: [p.report / "report.html", p.report / "metrics.json"],
        run=lambda p, c, r, record, fresh: stages.report(p, record, r),
    ),
)
STAGE_NAMES = tuple(stage.name for stage in STAGES)


def input_hashes(image_path: Path, known: dict[str, str]) -> dict[str, str]:
    """A key of every file below the image folder, sidecars included.

    Files whose size and time are those of the last run keep their key; the others are read.
    """
    hashes = {}
    for path in sorted(image_path.rglob("*")):
        try:
            if path.is_symlink() and not path.exists():
                continue
            if not path.is_file():
                continue
            stat = path.stat()
            name = path.relative_to(image_path).as_posix()
            stamp = f"{stat.st_size}:{stat.st_mtime_ns}:"
            old = known.get(name, "")
            hashes[name] = old if old.startswith(stamp) else stamp + hash_file(path)
        except OSError:
            continue  # the ingest stage says what is wrong with it
    return hashes


def hash_pixels(project: Project) -> str:
    """A key of what features and matches depend on: the images in their order, and the masks."""
    names = stages.read_project_series(project).names
    files = [project.images / name for name in names]
    if project.masks.is_dir():
        files += sorted(path for path in project.masks.rglob("*") if path.is_file())
    return hash_text(*(f"{path.name} {hash_file(path)}" for path in files))


def product_key(record: RunRecord, name: str, key: str) -> str:
    """What later stages see of a stage that stands: the pixels of ingest, the key of any other.

    A run with another tilt or pixel size keeps its features and matches.
    """
    stage = record.stages.get(name, {})
    return str(stage.get("pixels") or stage.get("key", key))


def standing_key(record: RunRecord, name: str, expected: str) -> str:
    """What later stages see of a stage that is not run now: it counts as it stands.

    Where that is of other options or inputs than it would be now, or nothing at all, they see that:
    a report is of the model and of the mesh, whichever came last.
    """
    stage = record.stages.get(name, {})
    if stage.get("status") != "done":
        return hash_text(expected, "nothing")
    if "pixels" in stage or stage["key"] == expected:
        return product_key(record, name, expected)
    return hash_text(expected, str(stage["key"]))


def run_stages(
    project_path: Path,
    config: Config,
    *,
    names: Sequence[str] = STAGE_NAMES,
    image_path: Path | None = None,
    reporter: Reporter | None = None,
    force: bool = False,
) -> RunRecord:
    """Run some stages of a project, in order.

    Parameters
    ----------
    names : stages to run; those before them must have run
    image_path : folder of the source images; needed for the ingest stage
    force : run them even when nothing has changed

    Raises
    ------
    InputError when the data do not allow a stage, UsageError when the call is wrong

    """
    reporter = reporter or Reporter(verbosity=-1)
    project = Project(Path(project_path))
    unknown = [name for name in names if name not in STAGE_NAMES]
    if unknown:
        raise UsageError(f"unknown stage {unknown[0]}: the stages are {', '.join(STAGE_NAMES)}")
    check_output(project)
    if image_path is not None:
        image_path = Path(image_path)
        if not image_path.exists():
            raise UsageError(f"{image_path} does not exist: give the folder with the images")
    elif "ingest" in names:
        raise UsageError("the ingest stage needs the folder with the images")
    elif not project.series.is_file():
        raise UsageError(f"{project.path} is not a semsfm project: run `semsfm extract` first")
    with locked(project):
        # another process may have written it until now
        record = RunRecord.read(project.record)
        if image_path is not None:
            record.image_path = str(image_path.resolve())
            record.inputs = input_hashes(image_path, record.inputs)
        record.seed = config.seed
        try:
            _run(project, config, record, names, reporter, force)
        finally:
            reporter.close()
    return record


def _run(
    project: Project,
    config: Config,
    record: RunRecord,
    names: Sequence[str],
    reporter: Reporter,
    force: bool,
) -> None:
    key = hash_text(
        STAGE_FORMAT,
        record.image_path,
        *(f"{name} {value.rsplit(':', 1)[-1]}" for name, value in sorted(record.inputs.items())),
    )
    for stage in STAGES:
        if stage.name == "map" and project.series.is_file():
            # the first to ask for more of the series than its pixels: size, tilts, warnings
            key = hash_text(key, hash_file(project.series))
        text = [options_key(getattr(config, section)) for section in stage.sections]
        # the seed and nothing else of the top level changes a result
        key = hash_text(key, stage.name, str(config.seed), *text)
        outputs = stage.outputs(project)
        if stage.name not in names:
            here = STAGE_NAMES.index(stage.name)
            needed = any(STAGE_NAMES.index(n) > here for n in names) and not stage.optional
            if needed and not all(path.exists() for path in outputs):
                raise InputError(
                    f"{outputs[0]} is missing: run `semsfm {stage.name}` on the project first"
                )
            key = standing_key(record, stage.name, key)
            continue
        done = record.is_done(stage.name, key) and all(path.exists() for path in outputs)
        if done and not force:
            reporter.say(f"{stage.name}: up to date")
            key = product_key(record, stage.name, key)
            continue
        begin = time.monotonic()
        started = record.stages.get(stage.name, {})
        # a run with the same key that was cut off goes on; anything else starts afresh
        fresh = force or started.get("key") != key
        if stage.name != "ingest":
            reporter.log_to(project.log)
            record.stages[stage.name] = {"status": "running", "key": key}
            record.write()
        try:
            summary = stage.run(project, config, reporter, record, fresh)
        except SemSfmError as error:
            if stage.name != "ingest":
                record.stages[stage.name] = {
                    "status": "failed",
                    "key": "",
                    "seconds": time.monotonic() - begin,
                    "peak_memory_mb": peak_memory_mb(),
                    "summary": {"notes": [f"{stage.name}: {error}"]},
                }
                record.write()
            if not stage.optional:
                raise
            reporter.warn(f"{stage.name}: {error}")
            continue
        record.stages[stage.name] = {
            "status": "done",
            "key": key,
            "seconds": time.monotonic() - begin,
            "peak_memory_mb": peak_memory_mb(),
            "summary": summary,
        }
        if stage.name == "ingest":
            record.stages[stage.name]["pixels"] = hash_pixels(project)
            reporter.log_to(project.log)
        key = product_key(record, stage.name, key)
        record.write()
        write_config(config, project.config)


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
    image_path : folder of PNG, JPEG or TIFF images of one specimen, tilted or rotated
    output_path : the project folder, see docs/files.md; unchanged stages of an earlier run are kept
    config : all options

    Returns
    -------
    RunRecord, the content of run.json

    """
    return run_stages(
        Path(output_path), config or Config(), image_path=Path(image_path), reporter=reporter
    )
