"""What the ingest stage reads: the images with all that lies beside them, the table, the masks."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from semsfm_colmap.ingest.files.listing import files_below, source_files
from semsfm_colmap.ingest.masks.given import find_masks_folder
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.pipeline.fingerprint import content, fingerprint
from semsfm_colmap.pipeline.record import RunRecord, hash_text


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
            yield f"--masks_path/{path.relative_to(masks).as_posix()}", path


def source_key(record: RunRecord, stage_format: str) -> str:
    """A key of what was read, as the record holds it."""
    return hash_text(
        stage_format,
        record.image_path,
        *(f"{name} {content(value)}" for name, value in sorted(record.inputs.items())),
    )
