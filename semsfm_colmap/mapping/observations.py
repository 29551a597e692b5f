"""Verified matches of pairs become the observations of a series."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from semsfm_colmap.geometry.epipolar import epipolar_residual, estimate_affine_fundamental
from semsfm_colmap.records import TrackCounts
from semsfm_colmap.tracks.build import build_tracks
from semsfm_colmap.tracks.cycles import consistent_matches
from semsfm_colmap.tracks.options import TrackOptions
from semsfm_colmap.types import Float, Int, Observations

MIN_PAIR_MATCHES = 5
"""Below this an affine fundamental matrix fits anything: four matches determine it."""


def join_matches(
    keypoints: Sequence[Float], matches: Mapping[tuple[int, int], Int], options: TrackOptions
) -> tuple[Observations, TrackCounts]:
    """Verified matches of pairs (i, j) -> tracks, with the counts of the joining.

    Parameters
    ----------
    keypoints : (K, 2) px of each image, in acquisition order
    matches : (L, 2) keypoint indices of each pair of image numbers

    """
    ordered = {
        (min(pair), max(pair)): rows if pair[0] < pair[1] else rows[:, ::-1]
        for pair, rows in matches.items()
    }
    num_inconsistent = 0
    if options.cycle_consistency:
        keep = consistent_matches([len(xy) for xy in keypoints], ordered)
        num_inconsistent = sum(int((~good).sum()) for good in keep.values())
        ordered = {pair: rows[keep[pair]] for pair, rows in ordered.items()}
    usable, residuals = {}, {}
    for (i, j), rows in ordered.items():
        if len(rows) < MIN_PAIR_MATCHES:
            continue
        xy1, xy2 = keypoints[i][rows[:, 0]], keypoints[j][rows[:, 1]]
        usable[i, j] = rows
        residuals[i, j] = epipolar_residual(estimate_affine_fundamental(xy1, xy2), xy1, xy2)
    observations, counts = build_tracks(
        list(keypoints), usable, residuals, min_length=options.min_length
    )
    return observations, TrackCounts(
        num_tracks=observations.num_tracks, **counts, num_inconsistent=num_inconsistent
    )
