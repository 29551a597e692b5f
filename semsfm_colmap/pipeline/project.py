"""The project folder: where each file lies."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from semsfm_colmap.errors import UsageError
from semsfm_colmap.io import layout

if TYPE_CHECKING:
    from semsfm_colmap.types import Reconstruction, SemSeries

MODELS_LOCK_FILE = ".semsfm-models.lock"
"""The lock of a folder of models, which may hold another program's project besides."""


@dataclass(frozen=True)
class Project:
    """Paths of one project."""

    path: Path

    @property
    def config(self) -> Path:
        """The resolved configuration."""
        return self.path / layout.CONFIG_FILE

    @property
    def record(self) -> Path:
        """Versions, stage times, seeds, input hashes."""
        return self.path / layout.RECORD_FILE

    @property
    def log(self) -> Path:
        """What was said while running."""
        return self.path / layout.LOG_FILE

    @property
    def series(self) -> Path:
        """The prepared series."""
        return self.path / layout.SERIES_FILE

    @property
    def database(self) -> Path:
        """COLMAP's database."""
        return self.path / layout.DATABASE_FILE

    @property
    def images(self) -> Path:
        """Prepared images."""
        return self.path / layout.IMAGES_FOLDER

    @property
    def masks(self) -> Path:
        """Masks in COLMAP's convention."""
        return self.path / layout.MASKS_FOLDER

    @property
    def sparse(self) -> Path:
        """COLMAP models."""
        return self.path / layout.SPARSE_FOLDER

    @property
    def dense(self) -> Path:
        """Depth maps and the fused cloud."""
        return self.path / layout.DENSE_FOLDER

    @property
    def mesh(self) -> Path:
        """Meshes."""
        return self.path / layout.MESH_FOLDER

    @property
    def report(self) -> Path:
        """The report."""
        return self.path / layout.REPORT_FOLDER

    @property
    def segments(self) -> Path:
        """Labelled parts."""
        return self.path / layout.SEGMENTS_FOLDER

    @property
    def cuts(self) -> Path:
        """Cuts made by hand."""
        return self.path / layout.CUTS_FILE

    @property
    def metrology(self) -> Path:
        """What was measured on the surface."""
        return self.path / layout.METROLOGY_FOLDER

    @property
    def feature_study(self) -> Path:
        """Detectors and descriptors compared."""
        return self.path / layout.FEATURE_STUDY_FOLDER

    @property
    def measurements(self) -> Path:
        """What to measure, made by hand."""
        return self.path / layout.MEASUREMENTS_FILE

    def read_series(self) -> SemSeries:
        """The prepared series."""
        from semsfm_colmap.ingest.series.file import read_series

        return read_series(self.series)

    def read_main_model(self) -> Reconstruction:
        """The first model."""
        from semsfm_colmap.colmap.model.sparse import read_model

        return read_model(self.sparse / "0")

    @property
    def masks_or_none(self) -> Path | None:
        """The masks folder when it holds any."""
        return self.masks if self.masks.is_dir() and any(self.masks.iterdir()) else None


def open_project(path: Path | str, *, new: bool = False) -> Project:
    """The project in a folder, of this version of the program or an older one.

    Parameters
    ----------
    new : it may be that it is still to be made

    Raises
    ------
    InputError
        A newer version of the program has made it.
    UsageError
        The path is no folder.

    """
    from semsfm_colmap.pipeline.record import RunRecord

    project = Project(Path(path))
    if not new and not project.path.is_dir():
        raise UsageError(f"{project.path} is not a folder: give a project folder")
    RunRecord.read(project.record)
    return project


def check_output(project: Project, places: Iterable[str]) -> None:
    """Refuse a folder that holds what another program made.

    Parameters
    ----------
    places : names that another program may have left; they are never overwritten

    """
    if project.path.exists() and not project.path.is_dir():
        raise UsageError(f"{project.path} is a file: give a folder as --output_path")
    if project.record.is_file() or (project.path / layout.LOCK_FILE).is_file():
        return
    for name in places:
        if (project.path / name).exists():
            raise UsageError(
                f"{project.path / name} exists but was not made by semsfm: give another "
                "--output_path, so that nothing is overwritten"
            )


def locked(project: Project) -> AbstractContextManager[None]:
    """Hold the project for this process; a second one is told so at once."""
    return locked_folder(project.path, layout.LOCK_FILE)


@contextmanager
def locked_folder(path: Path, lock_file: str) -> Iterator[None]:
    """Hold a folder that results are written to; made when it is missing.

    The lock file stays: were it removed, a process that has just opened it would hold a lock that
    the next one cannot see. A killed process gives its lock back to the system.
    """
    from filelock import FileLock, Timeout

    lock = FileLock(path / lock_file)
    try:
        path.mkdir(parents=True, exist_ok=True)
        lock.acquire(timeout=0)
    except Timeout as error:
        raise UsageError(
            f"{path} is in use by another semsfm process: wait for it or stop it"
        ) from error
    except OSError as error:
        raise UsageError(
            f"{path} cannot be written ({error.strerror}): give another --output_path"
        ) from error
    try:
        yield
    finally:
        if [entry.name for entry in path.iterdir()] == [lock_file]:
            # nothing came of it: the folder need not have been made
            with suppress(PermissionError):
                (path / lock_file).unlink()
            lock.release()
            with suppress(OSError):
                (path / lock_file).unlink(missing_ok=True)  # Windows keeps what is open
                path.rmdir()
        else:
            lock.release()
