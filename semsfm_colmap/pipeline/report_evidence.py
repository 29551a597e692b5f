"""What the stages left of a project's images: keypoints, matches, tracks, depth maps."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from semsfm_colmap.config import Config
from semsfm_colmap.pipeline.project import Project
from semsfm_colmap.pipeline.record import RunRecord
from semsfm_colmap.records import MATCH_STEPS
from semsfm_colmap.types import Array, DepthMap, Int

if TYPE_CHECKING:
    from semsfm_colmap.report.images.evidence import PairEvidence, SeriesEvidence

PAIR_CODE = 2**32
"""A match as one number: keypoints are counted below this."""


def read_evidence(project: Project, record: RunRecord, config: Config) -> SeriesEvidence:
    """Everything the report shows of the images; without a database, their pixels alone."""
    from semsfm_colmap.io.grey import read_grey
    from semsfm_colmap.pipeline.stages.map import build_observations
    from semsfm_colmap.report.images.evidence import ImageEvidence, SeriesEvidence
    from semsfm_colmap.surface.files import depth_map_path, read_depth_map

    folder = project.dense / "depth_maps"

    def pixels(name: str) -> Array:
        return read_grey(project.images / name)

    def depth_map(name: str) -> DepthMap | None:
        return read_depth_map(folder, name) if depth_map_path(folder, name).is_file() else None

    if not project.database.is_file():
        return SeriesEvidence(read_pixels=pixels, images={}, read_depth_map=depth_map)
    keypoints, ids = read_measured(project, record)
    names = project.read_series().names
    tracks, _, _ = build_observations(project, record, config)
    tracked = {name: np.zeros(len(rows), dtype=bool) for name, rows in keypoints.items()}
    for i, name in enumerate(names):
        tracked[name][tracks.keypoint_idx[tracks.image_idx == i]] = True
    return SeriesEvidence(
        read_pixels=pixels,
        images={
            name: ImageEvidence(keypoints=rows, in_track=tracked[name])
            for name, rows in keypoints.items()
        },
        pairs=read_pairs(project, ids, {name: len(rows) for name, rows in keypoints.items()}),
        tracks=tracks,
        track_names=names,
        read_depth_map=depth_map,
    )


def read_measured(project: Project, record: RunRecord) -> tuple[dict[str, Array], dict[int, str]]:
    """The measured keypoints of each image of the series as stored, and the names by image id."""
    from semsfm_colmap.colmap.database.measured import read_num_measured
    from semsfm_colmap.colmap.database.reader import read_database
    from semsfm_colmap.records import ExtractRecord

    names = set(project.read_series().names)
    measured = read_num_measured(project.database)
    extracted = record.result("extract", ExtractRecord)
    with read_database(project.database) as reader:
        ids = {i.image_id: i.name for i in reader.images() if i.name in names}
        if measured is None:
            counts = {} if extracted is None else extracted.num_keypoints
            measured = {k: counts[name] for k, name in ids.items() if name in counts}
        rows = {name: reader.keypoints(k)[: measured.get(k)] for k, name in ids.items()}
    return rows, ids


def read_pairs(
    project: Project, ids: dict[int, str], num: dict[str, int]
) -> tuple[PairEvidence, ...]:
    """The raw matches of each pair of the series with the filter that dropped each."""
    from semsfm_colmap.colmap.database.match_steps import read_match_steps
    from semsfm_colmap.colmap.database.reader import read_database
    from semsfm_colmap.colmap.database.work import read_inlier_matches
    from semsfm_colmap.report.images.evidence import PairEvidence

    inliers = read_inlier_matches(project.database)
    known_steps = read_match_steps(project.database)
    pairs = []
    with read_database(project.database) as reader:
        for a, b in reader.pairs():
            if a not in ids or b not in ids:
                continue
            rows = reader.raw_matches((a, b))
            if len(rows) == 0:
                continue
            step = known_steps.get((a, b))
            known = step is not None and len(step) == len(rows)
            if step is None or not known:
                step = steps_from_inliers(rows, inliers.get((a, b)))
            names = ids[a], ids[b]
            measured = (rows[:, 0] < num[names[0]]) & (rows[:, 1] < num[names[1]])
            pairs.append(
                PairEvidence(
                    names=names, matches=rows[measured], step=step[measured], steps_known=known
                )
            )
    return tuple(pairs)


def steps_from_inliers(rows: Int, inliers: Int | None) -> Int:
    """(L,) the last step for verified matches and 0 for others: which filter, nobody kept."""
    step = np.zeros(len(rows), dtype=np.int64)
    if inliers is not None:
        code = inliers[:, 0] * PAIR_CODE + inliers[:, 1]
        step[np.isin(rows[:, 0] * PAIR_CODE + rows[:, 1], code)] = len(MATCH_STEPS) - 1
    return step
