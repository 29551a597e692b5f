"""The trial of `matching.orientation` on a project's images, with COLMAP's SIFT."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import count

from semsfm_colmap.matching.orientation import Trial
from semsfm_colmap.pipeline.project import Project
from semsfm_colmap.types import Features, SemSeries

NUM_FEATURES = 2000
"""Keypoints of an image that the trial looks at."""
FIRST_OCTAVE = 0
"""The trial does without the finest ones, which take most of the time."""


def unwatched(done: int, total: int) -> None:
    """Nobody watches."""


def try_project_orientations(
    project: Project,
    series: SemSeries,
    *,
    num_threads: int,
    seed: int = 0,
    progress: Callable[[int, int], None] = unwatched,
) -> Trial:
    """Match a few pairs of three images or more both ways."""
    from semsfm_colmap.colmap.sift_features import sift_features
    from semsfm_colmap.matching.orientation import try_orientations

    done = count(1)

    def features_of(images: Sequence[int], upright: bool) -> list[Features]:
        frames = [series.frames[k] for k in images]
        progress(next(done), 3)  # each way, then matching
        return sift_features(
            "colmap-sift",
            project.images,
            [frame.name for frame in frames],
            [(frame.width_px, frame.height_px) for frame in frames],
            max_num_features=NUM_FEATURES,
            upright=upright,
            first_octave=FIRST_OCTAVE,
            mask_path=project.masks_or_none,
            num_threads=num_threads,
        )

    return try_orientations(len(series.names), features_of, seed=seed)
