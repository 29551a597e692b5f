"""What the ingest stage reads: the images with all that lies beside them, the table, the masks."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from semsfm_colmap.errors import UsageError
from semsfm_colmap.ingest.files.listing import IMAGE_SUFFIXES, files_below, source_files
from semsfm_colmap.ingest.files.mrc import STACK_SUFFIXES
from semsfm_colmap.ingest.masks.given import find_masks_folder
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.pipeline.fingerprint import content, fingerprint
from semsfm_colmap.pipeline.project import Project
from semsfm_colmap.pipeline.record import RunRecord, hash_text
from semsfm_colmap.pipeline.reporter import Reporter

MASK_NAMES = "--masks_path/"
"""Before the name of a mask that lies outside the folder of the images."""


def input_hashes(
    image_path: Path,
    known: dict[str, str],
    options: IngestOptions | None = None,
    project_path: Path | None = None,
) -> dict[str, str]:
    """A fingerprint of every file that the ingest stage may read, by name.

    Parameters
    ----------
    image_path : folder of the images, or a stack
    known : those of the last run: what has not been touched since is not read again
    options : name the table and the masks, which may lie elsewhere
    project_path : what lies in it is an output, also where it is a folder of the images

    """
    hashes = {}
    for name, path in named_files(image_path, options or IngestOptions(), project_path):
        try:
            if path.is_file():
                hashes[name] = fingerprint(path, known.get(name, ""))
        except OSError:
            continue  # the ingest stage says what is wrong with it
    return hashes


def named_files(
    image_path: Path, options: IngestOptions, project_path: Path | None = None
) -> Iterator[tuple[str, Path]]:
    """The files with names that say what each is to the stage."""
    root = image_path if image_path.is_dir() else image_path.parent
    for path in source_files(image_path, project_path):
        yield path.relative_to(root).as_posix(), path
    if options.series_csv is not None:
        yield "--series_csv", options.series_csv
    if options.masks_path is not None and not options.masks_path.is_dir():
        return  # the stage says so
    masks = find_masks_folder(image_path, options)
    if masks is not None and masks.parent.resolve() != image_path.resolve():
        for path in files_below(masks):
            yield f"{MASK_NAMES}{path.relative_to(masks).as_posix()}", path


def source_key(record: RunRecord, stage_format: str) -> str:
    """A key of what was read, as the record holds it."""
    return hash_text(
        stage_format,
        record.image_path,
        *(f"{name} {content(value)}" for name, value in sorted(record.inputs.items())),
    )


def check_same_series(
    project: Project,
    record: RunRecord,
    image_path: Path,
    inputs: dict[str, str],
    reporter: Reporter,
    *,
    force: bool,
) -> None:
    """Refuse to put another series in the place of the one that a project was made from.

    A series may grow, and its folder may be moved or written anew: that is said and done. A folder
    elsewhere without a single image of the project is another series.

    Parameters
    ----------
    record : of the run before
    inputs : fingerprints of what is there now

    Raises
    ------
    UsageError
        All of the project would be replaced, and `force` does not say so.

    """
    before, now = images_of(record.inputs), images_of(inputs)
    if "ingest" not in record.stages or not now:
        return
    way_out = "give another --output_path, or --force to replace all of it"
    if not record.image_path:
        if not force:
            raise UsageError(f"{project.path} was merged from several series: {way_out}")
        reporter.warn(f"{project.path} was merged from several series and is replaced")
        return
    moved = str(image_path.resolve()) != record.image_path
    common = set(before.values()) & set(now.values())
    if before and not common and moved:
        sentence = f"{project.path} was made from other images, those of {record.image_path}"
        if not force:
            raise UsageError(f"{sentence}: {way_out}")
        reporter.warn(f"{sentence}, and is replaced")
    elif len(common) < len(set(before.values())):
        lost = len(set(before.values())) - len(common)
        reporter.warn(
            f"{lost} of {len(before)} images that {project.path} was made from are not there any "
            "more, or changed: what depends on them is made again"
        )


def images_of(inputs: dict[str, str]) -> dict[str, str]:
    """The content of the images and stacks among the inputs, by name."""
    return {
        name: content(value)
        for name, value in inputs.items()
        if name.lower().endswith((*IMAGE_SUFFIXES, *STACK_SUFFIXES))
        and not name.startswith(("masks/", MASK_NAMES))
    }
