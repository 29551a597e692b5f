"""What a stage has left behind, and whether it is still there as it was left.

run.json holds a fingerprint of every file that a stage wrote, and a key of its part of the
database. A file that is missing, emptied, cut short or changed since makes its stage run again. A
person may have changed it on purpose: what still reads, and has a way into the project, is kept in
CHANGED, and what takes it over is said.
"""

from __future__ import annotations

import shlex
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath

from semsfm_colmap.io.layout import DATABASE_FILE, DENSE_FOLDER, MASKS_FOLDER, SPARSE_FOLDER
from semsfm_colmap.pipeline.fingerprint import content, fingerprint
from semsfm_colmap.pipeline.project import Project
from semsfm_colmap.pipeline.record import RunRecord
from semsfm_colmap.pipeline.stage import Stage

CHANGED = "changed"
"""Folder of the project with what was changed by others and made again."""
MODEL_FILES = ("cameras.bin", "images.bin", "points3D.bin")
"""What another program changes of a model."""
FROM_IMAGES = ("ingest", "extract")
"""Stages that take the folder of the images, and have one command."""
EXAMPLES = 3
"""As many files are named in a sentence."""


@dataclass(frozen=True, kw_only=True)
class OutputCheck:
    """The outputs of a stage against what it left."""

    gone: tuple[str, ...]
    """names of what is missing, or emptied, or damaged so that nothing reads it"""
    changed: tuple[str, ...]
    """names of what has another content"""
    found: Mapping[str, str]
    """fingerprints of now"""

    @property
    def differ(self) -> bool:
        """Whether anything is not as it was left."""
        return bool(self.gone or self.changed)

    @property
    def without_database(self) -> OutputCheck:
        """The same of files alone: what a stage before has done to the database is no news."""
        gone, changed = (
            tuple(name for name in names if name != DATABASE_FILE)
            for names in (self.gone, self.changed)
        )
        return replace(self, gone=gone, changed=changed)

    @property
    def says(self) -> str:
        """What is wrong, as the beginning of a sentence."""
        names = (*self.gone, *self.changed)
        more = f" and {len(names) - EXAMPLES} more files" if len(names) > EXAMPLES else ""
        verb, it = ("are", "them") if len(names) > 1 else ("is", "it")
        how = f"not as the last run left {it}" if self.changed else "missing or damaged"
        return f"{', '.join(names[:EXAMPLES])}{more} {verb} {how}"


def fingerprints(stage: Stage, project: Project, known: Mapping[str, str]) -> dict[str, str]:
    """Of all that the stage has left; those that it has not written again may be `known`."""
    found = {}
    for path in sorted({*stage.outputs(project), *stage.writes(project)}):
        if path == project.database or not path.is_file():
            continue
        name = path.relative_to(project.path).as_posix()
        found[name] = fingerprint(path, known.get(name, ""))
    if stage.database_part is not None:
        found[database_name(stage)] = database_key(stage, project)
    return found


def check_outputs(stage: Stage, project: Project, known: Mapping[str, str]) -> OutputCheck:
    """Compare what is there with what was left.

    Parameters
    ----------
    known : fingerprints of what the stage left; a project of an older version has none, and of
        those it is asked only whether they are there

    """
    gone = [p for p in stage.outputs(project) if not p.exists()]
    names = [path.relative_to(project.path).as_posix() for path in gone]
    changed, found = [], {}
    for name, left in known.items():
        if name == database_name(stage):
            found[name] = database_key(stage, project)
            state = "" if found[name] == left else "changed" if found[name] else "gone"
            name = DATABASE_FILE
        else:
            state, found[name] = _state(project.path / name, left)
        if state == "changed":
            changed.append(name)
        elif state == "gone" and name not in names:
            names.append(name)
    return OutputCheck(gone=tuple(names), changed=tuple(changed), found=found)


def _state(path: Path, left: str) -> tuple[str, str]:
    """Whether a file is "", "changed" or "gone", and its fingerprint."""
    try:
        now = fingerprint(path, left)
        empty = path.stat().st_size == 0
    except OSError:
        return "gone", ""
    if content(now) == content(left):
        return "", now
    return ("gone" if empty else "changed"), now


def database_name(stage: Stage) -> str:
    """How the stage's part of the database is called among its outputs."""
    return f"{DATABASE_FILE}#{stage.database_part}"


def database_key(stage: Stage, project: Project) -> str:
    """A key of the stage's part of the database; "" where nothing reads it."""
    from semsfm_colmap.colmap.database.content import content_key

    if stage.database_part is None:
        return ""
    return content_key(project.database, stage.database_part) or ""


def command_of(stage: Stage, project: Project, record: RunRecord) -> str:
    """What to type so that a stage runs again, whatever it has left."""
    place = shlex.quote(str(project.path))
    if stage.name not in FROM_IMAGES:
        return f"semsfm {stage.name} {place}"
    images = shlex.quote(record.image_path) if Path(record.image_path).exists() else "IMAGES"
    if not record.image_path and record.stages:
        return f"semsfm merge PROJECT1 PROJECT2 --output_path {place}"
    return f"semsfm extract {images} --output_path {place}"


def keep_changed(project: Project, changed: Sequence[str]) -> list[str]:
    """Copies of what others changed and can be taken over, before it is made again; what to say.

    Parameters
    ----------
    changed : names of files of a stage

    """
    said = []
    models = {f"{SPARSE_FOLDER}/{PurePosixPath(n).parts[1]}" for n in changed if _is_of_model(n)}
    for name in sorted(models):
        if _reads_as_model(project.path / name):
            kept = _keep(project, name)
            places = f"{shlex.quote(str(project.path))} --model_path {shlex.quote(str(kept))}"
            command = f"semsfm adopt {places}"
            said.append(f"{name} as it was is kept in {kept}: `{command}` takes it over")
    masks = [n for n in changed if PurePosixPath(n).parts[0] == MASKS_FOLDER]
    masks = [n for n in masks if _reads_as_image(project.path / n)]
    if masks:
        kept = _keep(project, MASKS_FOLDER)
        said.append(
            f"the changed masks are kept in {kept}: `--masks_path {shlex.quote(str(kept))}` takes "
            "them"
        )
    if DATABASE_FILE in changed:
        kept = _keep(project, DATABASE_FILE)
        said.append(
            f"the changed database is kept as {kept}: `semsfm reconstruct IMAGES --output_path "
            f"{shlex.quote(str(project.path))} --database_path {shlex.quote(str(kept))}` takes its "
            "features and matches"
        )
    cloud = f"{DENSE_FOLDER}/fused.ply"
    if cloud in changed and _reads_as_ply(project.path / cloud):
        kept = _keep(project, cloud)
        said.append(
            f"the changed cloud is kept as {kept}: put it in the place of {project.path / cloud} "
            f"and run `semsfm mesh {shlex.quote(str(project.path))}`, which takes it as it stands"
        )
    return said


def _keep(project: Project, name: str) -> Path:
    """Copy a file or folder to CHANGED, in the place of what was kept there before."""
    source, target = project.path / name, project.path / CHANGED / name
    target.parent.mkdir(parents=True, exist_ok=True)
    if source.is_dir():
        shutil.rmtree(target, ignore_errors=True)
        shutil.copytree(source, target)
    else:
        shutil.copyfile(source, target)
    return target


def _is_of_model(name: str) -> bool:
    parts = PurePosixPath(name).parts
    return parts[0] == SPARSE_FOLDER and parts[2:] in {(file,) for file in MODEL_FILES}


def _reads_as_model(folder: Path) -> bool:
    """Whether `semsfm adopt` could open it."""
    from semsfm_colmap.colmap.model.rows import open_model
    from semsfm_colmap.errors import InputError

    try:
        open_model(folder)
    except InputError:
        return False
    return True


def _reads_as_image(path: Path) -> bool:
    from semsfm_colmap.errors import InputError
    from semsfm_colmap.io.grey import read_grey

    try:
        read_grey(path)
    except InputError:
        return False
    return True


def _reads_as_ply(path: Path) -> bool:
    from semsfm_colmap.errors import InputError
    from semsfm_colmap.io.ply import read_ply_cloud

    try:
        read_ply_cloud(path)
    except (InputError, ValueError, OSError):
        return False
    return True
