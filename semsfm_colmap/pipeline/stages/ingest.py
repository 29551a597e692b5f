"""Source images -> images/, masks/, series.json."""

from __future__ import annotations

from pathlib import Path

from semsfm_colmap.io.layout import IMAGES_FOLDER
from semsfm_colmap.pipeline.project import Project
from semsfm_colmap.pipeline.stage import Stage, StageRun
from semsfm_colmap.records import IngestRecord


def run(on: StageRun) -> IngestRecord:
    """Prepare the images of the folder that the record names."""
    from semsfm_colmap.ingest.prepare import prepare_series

    with on.reporter.progress("reading images") as progress:
        series = prepare_series(
            Path(on.record.image_path), on.project.path, on.config.ingest, progress=progress
        )
    for warning in series.warnings:
        on.reporter.warn(warning)
    on.reporter.say(
        f"{len(series.frames)} images, pixel size "
        + (
            f"{series.pixel_size_um:g} um ({series.pixel_size_source})"
            if series.pixel_size_um
            else "not known: lengths are in px"
        )
    )
    return IngestRecord(
        num_images=len(series.frames),
        pixel_size_um=series.pixel_size_um,
        warnings=series.warnings,
    )


def pixels(project: Project) -> str:
    """A key of what features and matches depend on: the images in their order, and the masks.

    A run with another tilt or pixel size keeps its features and matches.
    """
    from semsfm_colmap.pipeline.record import hash_file, hash_text

    files = [project.images / name for name in project.read_series().names]
    if project.masks.is_dir():
        files += sorted(path for path in project.masks.rglob("*") if path.is_file())
    return hash_text(*(f"{path.name} {hash_file(path)}" for path in files))


def prepared_files(project: Project) -> list[Path]:
    """The images and masks that series.json names: others may lie beside them."""
    from semsfm_colmap.ingest.series.file import read_written_files

    written = read_written_files(project.series)
    images = [project.images / name for name in written.images]
    return sorted(images + [project.masks / name for name in written.masks])


STAGE = Stage(
    name="ingest",
    help="read and prepare the images",
    description="Read and prepare the images of a folder.",
    sections=("ingest",),
    outputs=lambda p: [p.series, p.images],
    writes=prepared_files,
    run=run,
    product=pixels,
    places=(IMAGES_FOLDER,),
    founds=True,
)
