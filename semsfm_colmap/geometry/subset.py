"""Renumbering observations when tracks or images are left out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from semsfm_colmap.types import Array, Bool, Int, Observations


def keep_tracks(
    observations: Observations,
    mask: Array,
    *,
    min_length: int = 1,
    image_number: Int | None = None,
) -> tuple[Observations, Int]:
    """Select observations, drop tracks that become too short, number the rest without gaps.

    Parameters
    ----------
    mask : (O,) which observations to keep
    min_length : fewest observations of a kept track
    image_number : (M,) new number of each image, -1 for those left out; None keeps the numbers

    Returns
    -------
    observations, and the old numbers of the tracks kept (N',)

    """
    mask = np.asarray(mask, dtype=bool)
    if image_number is not None:
        mask = mask & (image_number[observations.image_idx] >= 0)
    track_idx = observations.track_idx
    length = np.bincount(
        track_idx if mask.all() else track_idx[mask], minlength=observations.num_tracks
    )
    alive = length >= max(min_length, 1)
    kept = np.flatnonzero(alive)
    new_track = np.cumsum(alive) - 1
    chosen = mask & alive[track_idx]
    # where all stay nothing is copied
    selected = observations if chosen.all() else observations.select(chosen)
    image_idx, num_images = selected.image_idx, selected.num_images
    if image_number is not None:
        image_idx = image_number[image_idx]
        num_images = int(image_number.max()) + 1
    return (
        replace(
            selected,
            image_idx=image_idx,
            track_idx=selected.track_idx if alive.all() else new_track[selected.track_idx],
            num_images=num_images,
            num_tracks=len(kept),
        ),
        kept,
    )


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
