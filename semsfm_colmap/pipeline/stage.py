"""A stage of the pipeline: one registration from which runner, folder and commands follow."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from semsfm_colmap.pipeline.project import Project
from semsfm_colmap.records import StageRecord

if TYPE_CHECKING:
    from semsfm_colmap.colmap.database.content import Part
    from semsfm_colmap.config import Config
    from semsfm_colmap.pipeline.executor import Executor
    from semsfm_colmap.pipeline.record import RunRecord
    from semsfm_colmap.pipeline.reporter import Reporter


@dataclass(frozen=True, kw_only=True, eq=False)
class StageRun:
    """What a stage is run with."""

    project: Project
    config: Config
    reporter: Reporter
    record: RunRecord
    """what the stages before have left"""
    executor: Executor
    fresh: bool = True
    """False when a run with the same inputs and options was cut off and goes on"""

    @property
    def local(self) -> Executor:
        """The executor for work in the memory of this process, libraries with own threads too."""
        from semsfm_colmap.pipeline.executor import ThreadExecutor

        if self.executor.shares_memory:
            return self.executor
        return ThreadExecutor(self.config.num_threads)


def no_files(project: Project, config: Config) -> Sequence[Path]:
    """Nothing but the results of the stage before."""
    return ()


def no_outputs(project: Project) -> Sequence[Path]:
    """Nothing but those files without which it is not done."""
    return ()


def files_in(folder: Path, pattern: str = "*") -> list[Path]:
    """All files below a folder whose names fit, hidden ones apart; none without a folder."""
    return sorted(
        path
        for path in (folder.rglob(pattern) if folder.is_dir() else ())
        if path.is_file() and not path.name.startswith(".")
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Stage:
    """What shapes a stage, what it leaves behind, how to run it."""

    name: str
    help: str
    """for the table of commands"""
    description: str
    """for the help of its own command"""
    sections: tuple[str, ...]
    """of the configuration that its results depend on"""
    outputs: Callable[[Project], Sequence[Path]]
    """files without which it is not done"""
    writes: Callable[[Project], Sequence[Path]] = no_outputs
    """all other files that it has left: where one differs later, it is made again"""
    database_part: Part | None = None
    """what it makes of the database, which has several authors"""
    run: Callable[[StageRun], StageRecord]
    inputs: Callable[[Project, Config], Sequence[Path]] = no_files
    """files that it reads beside the results of the stage before; their content is in its key"""
    product: Callable[[Project], str] | None = None
    """What later stages depend on, as a key; None: on everything that this one depends on."""
    places: tuple[str, ...] = ()
    """Names in the project folder that another program may have left: never overwritten."""
    optional: bool = False
    """A failure is a warning, not the end: what was computed before is worth having."""
    needs_open3d: bool = False
    """It is seen before the first stage begins whether open3d loads."""
    founds: bool = False
    """It makes the project: before it there is no folder to keep a record in."""
