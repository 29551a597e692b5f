"""What the tracks alone say about a series: too few views, images that share nothing, repeats.

A picture that is in the series twice adds nothing but doubles its weight. Its features lie at the
same places to a fraction of a pixel, which two exposures never do: their noise differs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from semsfm_colmap.tracks.diagnosis_kernels import count_common
from semsfm_colmap.types import Int, Observations

SAME_PICTURE_PX = 0.05
"""Two exposures of the same view differ by their noise, 0.1 px or more in each coordinate; a copy
by the rounding of keypoints, or a little more when it was compressed again."""
SAME_PICTURE_SHARE = 0.9
"""Share of the common tracks that must lie at the same place."""
MIN_COMMON = 20
"""Fewer common tracks could agree by chance."""


@dataclass(frozen=True, kw_only=True)
class TrackDiagnosis:
    """The views that the tracks join."""

    num_images: int
    """images that have a track"""
    longest: int
    """most images of a track"""
    without_tracks: tuple[int, ...]
    """images that share no track with any other"""
    repeated: tuple[tuple[int, int], ...]
    """pairs of images that are the same picture"""

    def failure(self, min_block_tracks: int) -> tuple[str, str]:
        """Status and sentence when no part of the series can be reconstructed."""
        if self.num_images == 2:
            return (
                "two_views",
                "only two images share tracks, and two orthographic views leave a one-parameter "
                "family of shapes, however many points they show; take at least a third image at "
                "another tilt",
            )
        if self.longest == 2:
            return (
                "tracks_of_length_two",
                "every track is seen in two images only, and two orthographic views leave a "
                "one-parameter family of shapes; match more pairs so that three images share "
                "tracks",
            )
        return (
            "no_overlap",
            f"no three images share {min_block_tracks} tracks: the images do not overlap, or they "
            "show too little texture to be matched; use smaller tilt steps or check that all "
            "images show the same specimen",
        )

    def notes(self, names: Sequence[str]) -> dict[str, str]:
        """Sentences, by status, about what does not stop the rest."""
        found = {}
        if self.repeated:
            pairs = ", ".join(f"{names[a]} = {names[b]}" for a, b in self.repeated[:5])
            found["duplicated_image"] = (
                f"the same picture is in the series twice ({pairs}): it adds nothing and counts "
                "double in the error bars; leave one of them out"
            )
        if self.without_tracks:
            listed = ", ".join(names[i] for i in self.without_tracks[:5])
            more = " ..." if len(self.without_tracks) > 5 else ""
            found["image_without_tracks"] = (
                f"{len(self.without_tracks)} image(s) share no track with any other: {listed}{more}"
                "; they show something else, are out of focus, or too far in tilt from the others"
            )
        return found


def repeated_pictures(observations: Observations) -> tuple[tuple[int, int], ...]:
    """Pairs of images (a < b) whose common tracks lie at the same places."""
    obs = observations
    shape = (obs.num_images, obs.num_images)
    common, same = np.zeros(shape, dtype=np.int64), np.zeros(shape, dtype=np.int64)
    bounds: Int = np.searchsorted(obs.track_idx, np.arange(obs.num_tracks + 1))
    count_common(bounds, obs.image_idx, obs.xy, SAME_PICTURE_PX**2, common, same)
    a, b = np.nonzero((common >= MIN_COMMON) & (same >= SAME_PICTURE_SHARE * common))
    return tuple((int(min(i, j)), int(max(i, j))) for i, j in zip(a, b, strict=True))


def diagnose_tracks(observations: Observations) -> TrackDiagnosis:
    """Look at the tracks of two and more observations, sorted by track."""
    obs = observations
    length = np.bincount(obs.track_idx, minlength=obs.num_tracks)
    joined = obs.image_idx[length[obs.track_idx] >= 2]
    seen = np.bincount(joined, minlength=obs.num_images) > 0
    return TrackDiagnosis(
        num_images=int(seen.sum()),
        longest=int(np.max(length, initial=0)),
        without_tracks=tuple(np.flatnonzero(~seen).tolist()),
        repeated=repeated_pictures(obs),
    )
