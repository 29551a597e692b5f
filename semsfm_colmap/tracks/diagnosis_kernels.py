"""Compiled counts of what images have in common (see `diagnosis`)."""

from __future__ import annotations

import numba

from semsfm_colmap.types import Float, Int


@numba.njit(cache=True)
def count_common(
    pointer: Int, image_idx: Int, xy: Float, limit2: float, common: Int, same: Int
) -> None:
    """Tracks that two images share, and those among them at the same place: (M, M) each."""
    for j in range(len(pointer) - 1):
        for a in range(pointer[j], pointer[j + 1]):
            for b in range(pointer[j], a):
                du, dv = xy[a, 0] - xy[b, 0], xy[a, 1] - xy[b, 1]
                common[image_idx[b], image_idx[a]] += 1
                same[image_idx[b], image_idx[a]] += du * du + dv * dv < limit2
