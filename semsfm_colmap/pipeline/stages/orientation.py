"""The trial of `matching.orientation` on a project's images, with OpenCV's SIFT."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from semsfm_colmap.features.opencv_sift import describe_sift, detect_sift
from semsfm_colmap.io.grey import read_grey, read_mask
from semsfm_colmap.matching.orientation import Trial, pilot_images, try_orientations
from semsfm_colmap.pipeline.project import Project
from semsfm_colmap.types import Features, ParallelMap, SemSeries

NUM_FEATURES = 2000
"""Keypoints of an image that the trial looks at."""
FIRST_OCTAVE = 0
"""The trial does without the finest ones, which take most of the time."""


def unwatched(done: int, total: int) -> None:
    """Nobody watches."""


@dataclass(frozen=True, kw_only=True)
class FindBoth:
    """Finds the keypoints of an image, and describes them both ways."""

    image_path: Path
    mask_path: Path | None

    def __call__(self, name: str) -> tuple[Features, Features]:
        """Turned, upright."""
        detected = detect_sift(
            read_grey(self.image_path / name),
            read_mask(self.mask_path, name),
            first_octave=FIRST_OCTAVE,
        )
        turned, upright = (
            describe_sift(detected, max_num_features=NUM_FEATURES, upright=upright)
            for upright in (False, True)
        )
        return turned, upright


def try_project_orientations(
    project: Project,
    series: SemSeries,
    *,
    seed: int = 0,
    progress: Callable[[int, int], None] = unwatched,
    parallel_map: ParallelMap = map,
) -> Trial:
    """Match a few pairs of three images or more both ways.

    Parameters
    ----------
    parallel_map : over the images of the trial

    """
    pilots = sorted({k for trio in pilot_images(len(series.names)) for k in trio})
    find = FindBoth(image_path=project.images, mask_path=project.masks_or_none)
    found = {}
    for k, both in zip(pilots, parallel_map(find, [series.names[k] for k in pilots]), strict=True):
        found[k] = both
        progress(len(found), len(pilots) + 1)  # the matching is the last one
    return try_orientations(
        len(series.names), lambda images, upright: [found[k][upright] for k in images], seed=seed
    )
