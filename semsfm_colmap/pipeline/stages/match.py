"""Keypoints -> matches and two-view geometries in database.db; resumes pair by pair."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from semsfm_colmap.pipeline.stage import Stage, StageRun
from semsfm_colmap.records import MatchRecord

if TYPE_CHECKING:
    from pathlib import Path

    from semsfm_colmap.config import Config
    from semsfm_colmap.pipeline.project import Project
    from semsfm_colmap.types import Float, Int, SemSeries


def run(on: StageRun) -> MatchRecord:
    """Match the pairs that have no matches yet, then verify all."""
    from semsfm_colmap.colmap.database.work import clear_matches, read_images
    from semsfm_colmap.matching.pairs import pairs_around, select_pairs_of_series
    from semsfm_colmap.matching.statistics import background_note
    from semsfm_colmap.pipeline.stages.matches import match_pairs

    project, series = on.project, on.project.read_series()
    names = series.names
    if on.fresh:
        clear_matches(project.database)
    id_of = {image.name: image.image_id for image in read_images(project.database)}
    ids = [id_of[name] for name in names]
    angle = predicted_rotation(series)
    pairs = select_pairs_of_series(series.series_idx, on.config.matching, angle)
    if angle is not None:
        on.reporter.say("pairs: neighbours by the displacements recorded")
    with on.reporter.progress("matching pairs") as progress:
        match_pairs(on, names, pairs, progress=progress)
    found = verify_pairs(on, names, ids, pairs)
    number = {name: k for k, name in enumerate(names)}
    verified = [
        (number[p.image_name_1], number[p.image_name_2]) for p in found.pairs if p.failure is None
    ]
    more = sorted(set(pairs_around(verified, series.series_idx)) - set(pairs))
    if more:
        with on.reporter.progress("matching pairs") as progress:
            match_pairs(on, names, more, progress=progress)
        found = verify_pairs(on, names, ids, sorted({*pairs, *more}))
    note = background_note(found.pairs)
    if note is None:
        return found
    on.reporter.warn(note)
    return replace(found, notes=(note,))


def predicted_rotation(series: SemSeries) -> Float | None:
    """Angles (M,) in rad by the displacements, of each series for itself.

    None where the displacements are not known for all images.
    """
    import numpy as np

    from semsfm_colmap.ingest.series.tilt import recorded_displacements
    from semsfm_colmap.motion.belt import predicted_angles

    displacement = recorded_displacements(series)
    if displacement is None or np.isnan(displacement).any():
        return None
    return predicted_angles(displacement)


def files_of_order(project: Project, config: Config) -> Sequence[Path]:
    """What tells the order of the images, where that is not their names alone."""
    if not project.series.is_file() or predicted_rotation(project.read_series()) is None:
        return ()
    return (project.series,)


def verify_pairs(
    on: StageRun, names: Sequence[str], ids: Sequence[int], pairs: Sequence[tuple[int, int]]
) -> MatchRecord:
    """Affine two-view geometries of the stored matches, into the database."""
    from semsfm_colmap.colmap.database.match_steps import stored_steps, write_match_steps
    from semsfm_colmap.colmap.database.two_view import stored_geometry
    from semsfm_colmap.colmap.database.work import (
        read_keypoints,
        read_matches,
        write_two_view_geometries,
    )
    from semsfm_colmap.matching.statistics import pair_statistics
    from semsfm_colmap.matching.verify import PairVerifier

    stored = read_keypoints(on.project.database, ids)
    keypoints = [stored[image_id] for image_id in ids]
    raw = read_matches(on.project.database)
    verify = PairVerifier(keypoints=keypoints, options=on.config.matching, seed=on.config.seed)
    jobs = (((i, j), matches_of(raw, ids[i], ids[j])) for i, j in pairs)
    geometries = []
    with on.reporter.progress("verifying pairs") as progress:
        for geometry in on.executor.map(verify, jobs):
            geometries.append(geometry)
            progress(len(geometries), len(pairs))
    write_two_view_geometries(
        on.project.database, dict(stored_geometry(g, ids) for g in geometries)
    )
    write_match_steps(on.project.database, stored_steps(geometries, ids))
    verified = [g for g in geometries if g.F is not None]
    on.reporter.say(
        f"matching: {len(verified)} of {len(pairs)} pairs verified, "
        f"{sum(int(g.inlier.sum()) for g in verified)} matches"
    )
    return MatchRecord(
        num_pairs=len(pairs),
        num_verified_pairs=len(verified),
        pairs=tuple(pair_statistics(geometries, names)),
    )


def matches_of(raw: dict[tuple[int, int], Int], a: int, b: int) -> Int:
    """The matches (L, 2) of image a with image b, whichever way round they are stored."""
    import numpy as np

    rows = raw.get((a, b))
    if rows is not None:
        return rows
    return raw.get((b, a), np.zeros((0, 2), dtype=np.int64))[:, ::-1]


STAGE = Stage(
    name="match",
    help="match image pairs and verify them with affine epipolar geometry",
    description="Match image pairs and verify them with affine epipolar geometry.",
    sections=("matching",),
    outputs=lambda p: [p.database],
    database_part="matches",
    run=run,
    inputs=files_of_order,
)
