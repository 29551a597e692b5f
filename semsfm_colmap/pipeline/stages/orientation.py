"""The trial of `matching.orientation` on a project's images, with OpenCV's SIFT."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import count

from semsfm_colmap.io.grey import read_grey, read_mask
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
    seed: int = 0,
    progress: Callable[[int, int], None] = unwatched,
) -> Trial:
    """Match a few pairs of three images or more both ways."""
    from semsfm_colmap.features.opencv_sift import opencv_sift
    from semsfm_colmap.matching.orientation import try_orientations

    done = count(1)

    def features_of(images: Sequence[int], upright: bool) -> list[Features]:
        progress(next(done), 3)  # each way, then matching
        return [
            opencv_sift(
                read_grey(project.images / name),
                read_mask(project.masks_or_none, name),
                max_num_features=NUM_FEATURES,
                first_octave=FIRST_OCTAVE,
                upright=upright,
            )
            for name in (series.frames[k].name for k in images)
        ]

    return try_orientations(len(series.names), features_of, seed=seed)
