"""A COLMAP database that somebody else filled -> COLMAP models, as `colmap mapper` does.

Whatever the database says about two-view geometry was found with a perspective camera, or not at
all; its matches are verified again with the affine model, as our own are. The database is only
read.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from semsfm_colmap.config import Config
from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.pipeline.executor import Executor, open_executor
from semsfm_colmap.pipeline.project import MODELS_LOCK_FILE, Project, locked_folder
from semsfm_colmap.pipeline.reporter import Reporter
from semsfm_colmap.pipeline.sparse_models import MatchedSeries, map_series
from semsfm_colmap.records import MapRecord
from semsfm_colmap.types import (
    AffineTwoViewGeometry,
    Bool,
    Float,
    SemFrame,
    SemMetadata,
    SemSeries,
)

if TYPE_CHECKING:
    from semsfm_colmap.colmap.database.reader import DatabaseReader, StoredImage

PAIRS_IN_MEMORY = 64
"""Pairs whose raw matches are held at a time."""


def map_database(
    database_path: Path | str,
    output_path: Path | str,
    config: Config | None = None,
    *,
    image_path: Path | str | None = None,
    reporter: Reporter | None = None,
) -> MapRecord:
    """Cameras and points from any COLMAP database into ``output_path/0, 1, ...``.

    Beside each model is a database of its own, with its cameras, from which COLMAP goes on.

    Parameters
    ----------
    database_path : COLMAP database of the 3.8 or 4.x schema; not changed
    output_path : folder for the models; an earlier result of ours in it is replaced
    config : all options; those of `ingest` say what is known of the series
    image_path : folder of the images, for the colours of the points; None leaves them grey
    reporter : told how far it is, and what to note; default: nothing is said

    Returns
    -------
    the record of the mapping, as in run.json

    Raises
    ------
    InputError
        It is no COLMAP database, it is damaged or in use, or its matches allow no model.
    UsageError
        A path is none of what is asked for, or `output_path` holds models of another program.

    """
    from semsfm_colmap.colmap.database.reader import read_database
    from semsfm_colmap.colmap.database.work import DatabaseImage
    from semsfm_colmap.colmap.model.model_database import write_model_database
    from semsfm_colmap.mapping.observations import join_matches

    config, reporter = config or Config(), reporter or Reporter(verbosity=-1)
    output_path = Path(output_path)
    image_path = None if image_path is None else Path(image_path)
    check_models_folder(output_path)
    with read_database(Path(database_path)) as reader:
        images = in_acquisition_order(reader.images())
        check_images(reader, images, image_path)
        series = series_of_database(reader.path, images, config)
        for warning in series.warnings:
            reporter.warn(warning)
        ids = [image.image_id for image in images]
        keypoints = [reader.xy(image_id) for image_id in ids]
        with open_executor(config, say=reporter.say) as executor:
            verified = {
                g.image_pair: (g.F, g.keypoints[g.inlier])
                for g in verify_database(reader, ids, keypoints, config, reporter, executor)
                if g.F is not None
            }
    matches = {pair: inliers for pair, (_, inliers) in verified.items()}
    # the model keeps every keypoint's number; those without a place have no matches by now
    keypoints = [np.nan_to_num(xy, posinf=0.0, neginf=0.0) for xy in keypoints]
    with locked_folder(output_path, MODELS_LOCK_FILE):
        observations, counts = join_matches(keypoints, matches, config.tracks)
        record = map_series(
            MatchedSeries(
                series=series,
                keypoints=dict(zip(series.names, keypoints, strict=True)),
                database_images={
                    i.name: DatabaseImage(image_id=i.image_id, name=i.name, camera_id=0)
                    for i in images
                },
                observations=observations,
                counts=counts,
            ),
            config,
            reporter,
            sparse_path=output_path,
            image_path=image_path,
        )
        geometries = {(ids[i], ids[j]): found for (i, j), found in verified.items()}
        for entry in record.models:
            write_model_database(output_path / Path(entry.model).name, geometries)
    return record


def check_models_folder(path: Path) -> None:
    """Refuse to put models where another program's lie."""
    from semsfm_colmap.colmap.model.sidecar import FILE_NAME

    if path.exists() and not path.is_dir():
        raise UsageError(f"{path} is a file: give a folder as --output_path")
    if path.name == "sparse" and Project(path.parent).record.is_file():
        raise UsageError(
            f"{path} belongs to the project {path.parent}: run `semsfm map {path.parent}`, or give "
            "another --output_path"
        )
    first = path / "0"
    if first.exists() and not (first / FILE_NAME).is_file():
        raise UsageError(
            f"{first} exists but was not made by semsfm: give another --output_path, so that "
            "nothing is overwritten"
        )


def in_acquisition_order(images: Sequence[StoredImage]) -> list[StoredImage]:
    """Natural order of the names (2 before 10): ids follow the threads that finished first."""
    from natsort import natsorted

    return natsorted(images, key=lambda image: image.name)


def check_images(
    reader: DatabaseReader, images: Sequence[StoredImage], image_path: Path | None
) -> None:
    """Refuse too few images, and a folder that does not hold them in the size they had."""
    if len(images) < 3:
        raise InputError(
            f"{reader.path} holds {len(images)} images: three are needed, two orthographic views "
            "leave a one-parameter family of shapes"
        )
    if image_path is None:
        return
    if not image_path.is_dir():
        raise UsageError(f"{image_path} is not a folder: give the folder with the images")
    for image in images:
        width, height = size_on_disk(image_path / image.name, reader.path)
        if (width, height) != (image.width_px, image.height_px):
            raise InputError(
                f"{image_path / image.name} is {width} x {height} px, but {reader.path} was made "
                f"from one of {image.width_px} x {image.height_px} px: give the images it was "
                "made from"
            )


def size_on_disk(path: Path, database_path: Path) -> tuple[int, int]:
    """Width and height as an image file's header says."""
    from semsfm_colmap.ingest.files.header import UnreadableImageError
    from semsfm_colmap.ingest.files.read import read_header
    from semsfm_colmap.ingest.options import IngestOptions

    if not path.is_file():
        raise InputError(
            f"{path} does not exist, but {database_path} names it: give the folder that the "
            "database was made from as --image_path"
        )
    try:
        header = read_header(path, IngestOptions().max_image_pixels)
    except UnreadableImageError as error:
        raise InputError(f"{path}: {error}") from error
    return header.width, header.height


def series_of_database(path: Path, images: Sequence[StoredImage], config: Config) -> SemSeries:
    """The images as a series; pixel size and tilt from the options, a database knows neither."""
    from semsfm_colmap.ingest.series.pixel_size import series_pixel_size
    from semsfm_colmap.ingest.series.table import SeriesRow, match_table, read_series_table

    names = [image.name for image in images]
    options = config.ingest
    rows: dict[str, SeriesRow] = {}
    warnings: list[str] = []
    if options.series_csv is not None:
        rows, warnings = match_table(read_series_table(options.series_csv), names)
    frames = []
    for image in images:
        row = rows.get(image.name)
        values: dict[str, float | None] = {}
        if row is not None:
            known = {
                "tilt_rad": None if row.tilt_deg is None else math.radians(row.tilt_deg),
                "stage_rotation_rad": None
                if row.rotation_deg is None
                else math.radians(row.rotation_deg),
                "pixel_size_um": row.pixel_size_um,
            }
            values = {key: value for key, value in known.items() if value is not None}
        source = "" if options.series_csv is None else f"table {options.series_csv.name}"
        frames.append(
            SemFrame(
                name=image.name,
                width_px=image.width_px,
                height_px=image.height_px,
                source_path=str(path),
                crop_px=(0, 0, image.width_px, image.height_px),
                metadata=SemMetadata(**values, source=dict.fromkeys(values, source)),  # type: ignore[arg-type]
            )
        )
    pixel_size = series_pixel_size(frames, options.pixel_size_um)
    return SemSeries(
        frames=tuple(frames),
        pixel_size_um=pixel_size.um,
        pixel_size_source=pixel_size.source,
        warnings=(*warnings, *pixel_size.warnings),
    )


def verify_database(
    reader: DatabaseReader,
    image_ids: Sequence[int],
    keypoints: Sequence[Float],
    config: Config,
    reporter: Reporter,
    executor: Executor,
) -> Iterator[AffineTwoViewGeometry]:
    """Affine two-view geometry of every pair that has matches, few pairs in memory at a time.

    Parameters
    ----------
    image_ids : in acquisition order; pairs with other images are left out
    keypoints : (K, 2) px of each; matches of keypoints that are not finite are left out

    """
    from semsfm_colmap.matching.verify import PairVerifier

    number = {image_id: i for i, image_id in enumerate(image_ids)}
    usable: list[Bool] = [np.asarray(np.isfinite(xy).all(axis=1)) for xy in keypoints]
    pairs = [(a, b) for a, b in reader.pairs() if a in number and b in number]
    if not pairs:
        count = sum(len(xy) for xy in keypoints)
        raise InputError(
            f"{reader.path} holds {count} keypoints but no matches of these images: match them "
            "first, e.g. with `colmap exhaustive_matcher`"
            if count
            else f"{reader.path} holds no keypoints of these images: fill it first, e.g. with "
            "`colmap feature_extractor` and `colmap exhaustive_matcher`"
        )

    verify = PairVerifier(keypoints=keypoints, options=config.matching, seed=config.seed)
    with reporter.progress("verifying pairs") as progress:
        num_verified = num_matches = 0
        for begin in range(0, len(pairs), PAIRS_IN_MEMORY):
            chunk = pairs[begin : begin + PAIRS_IN_MEMORY]
            jobs = []
            for a, b in chunk:
                i, j = number[a], number[b]
                rows = reader.matches((a, b), (len(keypoints[i]), len(keypoints[j]))).matches
                rows = rows[usable[i][rows[:, 0]] & usable[j][rows[:, 1]]]
                jobs.append(((i, j), rows) if i < j else ((j, i), rows[:, ::-1]))
            for geometry in executor.map(verify, jobs):
                num_verified += geometry.F is not None
                num_matches += int(geometry.inlier.sum())
                yield geometry
            progress(begin + len(chunk), len(pairs))
    reporter.say(
        f"{reader.path.name}: {num_verified} of {len(pairs)} pairs verified, {num_matches} matches"
    )
