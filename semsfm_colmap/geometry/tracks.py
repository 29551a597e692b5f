"""Renumbering observations when tracks or images are left out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from semsfm_colmap.types import Array, Int, Observations


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
    length = np.bincount(observations.track_idx[mask], minlength=observations.num_tracks)
    alive = length >= max(min_length, 1)
    kept = np.flatnonzero(alive)
    new_track = np.cumsum(alive) - 1
    selected = observations.select(mask & alive[observations.track_idx])
    image_idx, num_images = selected.image_idx, selected.num_images
    if image_number is not None:
        image_idx = image_number[image_idx]
        num_images = int(image_number.max()) + 1
    return (
        replace(
            selected,
            image_idx=image_idx,
            track_idx=new_track[selected.track_idx],
            num_images=num_images,
            num_tracks=len(kept),
        ),
        kept,
    )
