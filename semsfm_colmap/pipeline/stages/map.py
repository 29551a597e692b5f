"""Verified matches -> sparse/0 (and the twin or further parts); guided matches -> database.db."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from semsfm_colmap.io.layout import SPARSE_FOLDER
from semsfm_colmap.pipeline.stage import Stage, StageRun, files_in
from semsfm_colmap.records import ExtractRecord, MapRecord, MatchRecord, TrackCounts

if TYPE_CHECKING:
    from pathlib import Path

    from semsfm_colmap.config import Config
    from semsfm_colmap.pipeline.project import Project
    from semsfm_colmap.pipeline.record import RunRecord
    from semsfm_colmap.types import Float, Observations


def run(on: StageRun) -> MapRecord:
    """Map the series from its database."""
    from semsfm_colmap.colmap.database.work import read_images
    from semsfm_colmap.mapping.finish import MappedPart
    from semsfm_colmap.pipeline.guide import guide_from_folders
    from semsfm_colmap.pipeline.guided_keypoints import write_guided
    from semsfm_colmap.pipeline.sparse_models import MatchedSeries, map_series

    project, config = on.project, on.config
    series = project.read_series()
    observations, counts, keypoints = build_observations(project, on.record, config)
    images = {image.name: image for image in read_images(project.database)}
    matched = on.record.result("match", MatchRecord)

    def save(extended: Mapping[str, Float], parts: Sequence[MappedPart]) -> None:
        write_guided(
            project.database, images, keypoints, extended, parts, config.matching.min_num_inliers
        )

    return map_series(
        MatchedSeries(
            series=series,
            keypoints=keypoints,
            database_images=images,
            observations=observations,
            counts=counts,
            remarks=() if matched is None else matched.notes,
        ),
        config,
        on.reporter,
        sparse_path=project.sparse,
        image_path=project.images,
        guide=guide_from_folders(
            project.images,
            project.masks_or_none,
            keypoints,
            config.guided,
            # threads of this process are those of the alignment itself
            map if on.executor.shares_memory else on.executor.map,
        ),
        write_guided=save,
    )


def build_observations(
    project: Project, record: RunRecord, config: Config
) -> tuple[Observations, TrackCounts, dict[str, Float]]:
    """Verified matches of the database -> Observations, counts of the joining, keypoints by name.

    Keypoints that an earlier guided pass has added behind the measured ones are left out.
    """
    from semsfm_colmap.colmap.database.measured import read_num_measured
    from semsfm_colmap.colmap.database.work import read_images, read_inlier_matches, read_keypoints
    from semsfm_colmap.mapping.observations import join_matches

    database, names = project.database, project.read_series().names
    id_of = {image.name: image.image_id for image in read_images(database)}
    ids = [id_of[name] for name in names]
    number = {image_id: i for i, image_id in enumerate(ids)}
    stored = read_keypoints(database, ids)
    measured = read_num_measured(database)
    if measured is None:
        # a database of a version that kept the numbers in run.json alone
        extracted = record.result("extract", ExtractRecord)
        counts = {} if extracted is None else extracted.num_keypoints
        measured = {id_of[name]: counts[name] for name in names if name in counts}
    keypoints = [stored[image_id][: measured.get(image_id)] for image_id in ids]
    matches = {}
    for (a, b), rows in read_inlier_matches(database).items():
        if a in number and b in number:
            i, j = number[a], number[b]
            known = (rows[:, 0] < len(keypoints[i])) & (rows[:, 1] < len(keypoints[j]))
            matches[i, j] = rows[known]
    observations, joined = join_matches(keypoints, matches, config.tracks)
    return observations, joined, dict(zip(names, keypoints, strict=True))


def files_of_models(project: Project) -> Sequence[Path]:
    """The files of all models that a mapping has written."""
    from semsfm_colmap.pipeline.sparse_models import own_models

    return [path for folder in own_models(project.sparse) for path in files_in(folder)]


STAGE = Stage(
    name="map",
    help="cameras and points: factorization, filtering, bundle adjustment",
    description="Cameras and points from the verified matches of a project.",
    sections=("tracks", "factorization", "guided", "refinement", "export"),
    outputs=lambda p: [p.sparse / "0" / "points3D.bin", p.sparse / "0" / "orthographic.json"],
    writes=files_of_models,
    database_part="guided",
    run=run,
    # the first to ask for more of the series than its pixels: size, tilts, warnings
    inputs=lambda p, _: [p.series],
    places=(SPARSE_FOLDER,),
)
