"""Some of the images and tracks of a series, numbered without gaps, and the way back.

Stages work on parts of a series: registered images, tracks that are long enough, inliers. A
`Subset` holds the observations of such a part under numbers of its own, and which images, tracks
and observations of the whole they are.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from semsfm_colmap.types import Array, Bool, Int, Observations


def new_numbers(kept: Array, total: int) -> Int:
    """(total,) the place of each old number in `kept`, -1 for those that are not in it."""
    number = np.full(total, -1, dtype=np.int64)
    number[kept] = np.arange(len(kept))
    return number


def spread_over(length: int, most: int) -> Int:
    """At most so many of the numbers below `length`, evenly, the first and the last among them."""
    return np.unique(np.linspace(0, length - 1, min(most, length)).astype(np.int64))


@dataclass(frozen=True, kw_only=True, eq=False)
class Subset:
    """A part of a series: image k of it is image ``images[k]`` of the whole, and so with tracks."""

    images: Int
    """(m,)"""
    tracks: Int
    """(n,)"""
    rows: Bool
    """(O,) which observations of the whole are in it"""
    observations: Observations
    """Those, in the order of the whole, under the new numbers"""

    def in_whole(self, inside: Bool) -> Bool:
        """(O,) a mask of the whole's observations from one of the subset's."""
        mask = np.zeros(len(self.rows), dtype=bool)
        mask[np.flatnonzero(self.rows)[inside]] = True
        return mask


def take_subset(
    observations: Observations,
    *,
    images: Int | None = None,
    mask: Array | None = None,
    min_length: int = 1,
) -> Subset:
    """Select images and observations, drop tracks that become too short, number the rest.

    Parameters
    ----------
    images : numbers of the images, in their new order; None keeps all
    mask : (O,) which observations to keep; None keeps all
    min_length : fewest observations of a kept track

    """
    obs = observations
    mask = np.ones(len(obs), bool) if mask is None else np.asarray(mask, dtype=bool)
    image_number = None if images is None else new_numbers(images, obs.num_images)
    if image_number is not None:
        mask = mask & (image_number[obs.image_idx] >= 0)
    track_idx = obs.track_idx
    length = np.bincount(track_idx if mask.all() else track_idx[mask], minlength=obs.num_tracks)
    alive = length >= max(min_length, 1)
    new_track = np.cumsum(alive) - 1
    rows = mask & alive[track_idx]
    # where all stay nothing is copied
    selected = obs if rows.all() else obs.select(rows)
    image_idx = selected.image_idx
    tracks = np.flatnonzero(alive)
    return Subset(
        images=np.arange(obs.num_images) if images is None else images,
        tracks=tracks,
        rows=rows,
        observations=replace(
            selected,
            image_idx=image_idx if image_number is None else image_number[image_idx],
            track_idx=selected.track_idx if alive.all() else new_track[selected.track_idx],
            num_images=obs.num_images if images is None else len(images),
            num_tracks=len(tracks),
        ),
    )


def take_exactly(observations: Observations, images: Int, tracks: Int) -> Subset:
    """All observations of these tracks in these images, however few a track keeps."""
    obs = observations
    image_number = new_numbers(images, obs.num_images)
    track_number = new_numbers(tracks, obs.num_tracks)
    rows = (image_number[obs.image_idx] >= 0) & (track_number[obs.track_idx] >= 0)
    selected = obs.select(rows)
    return Subset(
        images=images,
        tracks=tracks,
        rows=rows,
        observations=replace(
            selected,
            image_idx=image_number[selected.image_idx],
            track_idx=track_number[selected.track_idx],
            num_images=len(images),
            num_tracks=len(tracks),
        ),
    )


def keep_tracks(
    observations: Observations, mask: Array, *, min_length: int = 1
) -> tuple[Observations, Int]:
    """`take_subset` of all images: the observations, and the old numbers of the tracks (N',)."""
    subset = take_subset(observations, mask=mask, min_length=min_length)
    return subset.observations, subset.tracks


def thin_evenly(observations: Observations, per_image: int) -> Bool:
    """Which tracks to keep (N,) so that every image keeps about `per_image` observations, or all.

    A track is kept with the largest share that one of its images asks for, spread evenly over the
    track numbers.
    """
    obs = observations
    count = np.bincount(obs.image_idx, minlength=obs.num_images)
    share = np.minimum(1.0, per_image / np.maximum(count, 1))
    wanted = np.zeros(obs.num_tracks)
    np.maximum.at(wanted, obs.track_idx, share[obs.image_idx])
    steps = np.floor(np.cumsum(wanted) + 1e-9)
    return np.asarray(np.diff(steps, prepend=0.0) > 0.0)
