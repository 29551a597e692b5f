"""Measurement matrices as observations."""

from __future__ import annotations

import numpy as np

from semsfm_colmap.types import Float, Observations


def observations_from_matrix(M: Float, min_length: int = 2) -> Observations:
    """(2 m, n) with nan for missing -> Observations of the tracks seen often enough."""
    xy = M.reshape(len(M) // 2, 2, -1).transpose(2, 0, 1)
    seen = np.isfinite(xy).all(axis=2)
    keep = seen.sum(axis=1) >= min_length
    xy, seen = xy[keep], seen[keep]
    track_idx, image_idx = np.nonzero(seen)
    return Observations(
        image_idx=image_idx,
        track_idx=track_idx,
        keypoint_idx=np.arange(len(track_idx)),
        xy=xy[seen],
        num_images=xy.shape[1],
        num_tracks=len(xy),
    )
