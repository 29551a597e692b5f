"""From verified pairs to tracks, contradictions resolved.

A track is a set of keypoints, at most one an image, joined by matches. Joining everything that
matches join (connected components) lets one false match fuse two tracks into one that sees an
image twice. Here the matches are taken in the order of their trust, smallest epipolar residual
first, and a match that would fuse two tracks with an image in common is refused.

Keypoints at the same place of an image (SIFT gives one an orientation) are one keypoint here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from semsfm_colmap.tracks.build_kernels import join, roots
from semsfm_colmap.types import Array, Float, Int, Observations

SAME_PLACE_PX = 0.01
"""Keypoints closer than this are one."""


def canonical_keypoints(xy: Float) -> Int:
    """For each keypoint the first one at the same place: (K, 2) -> (K,)."""
    if len(xy) == 0:
        return np.zeros(0, dtype=np.int64)
    cell = np.round(xy / SAME_PLACE_PX).astype(np.int64)
    _, first, inverse = np.unique(cell, axis=0, return_index=True, return_inverse=True)
    return first[inverse.ravel()].astype(np.int64)


def build_tracks(
    keypoints: Sequence[Float],
    matches: Mapping[tuple[int, int], Array],
    residuals: Mapping[tuple[int, int], Array] | None = None,
    *,
    min_length: int = 2,
) -> tuple[Observations, dict[str, int]]:
    """Join verified matches into tracks.

    Parameters
    ----------
    keypoints : for each image i its keypoints (K_i, 2) px
    matches : (i, j) -> (L, 2) keypoint indices
    residuals : (i, j) -> (L,) px, how far a match is from its pair's geometry; smaller is trusted
        more. Without it matches are taken pair by pair.
    min_length : fewest observations of a track

    Returns
    -------
    Observations sorted by track, then image, and counts: ``num_matches``, ``num_refused``

    """
    offsets = np.concatenate([[0], np.cumsum([len(k) for k in keypoints])]).astype(np.int64)
    total = int(offsets[-1])
    canonical = np.concatenate(
        [offsets[i] + canonical_keypoints(k) for i, k in enumerate(keypoints)]
        or [np.zeros(0, dtype=np.int64)]
    )
    image = np.repeat(np.arange(len(keypoints)), np.diff(offsets))
    first, second, trust = [], [], []
    for pair in sorted(matches):
        rows = np.asarray(matches[pair])
        first.append(canonical[offsets[pair[0]] + rows[:, 0]])
        second.append(canonical[offsets[pair[1]] + rows[:, 1]])
        r = np.zeros(len(rows)) if residuals is None else np.abs(residuals[pair])
        trust.append(r)
    parent = np.arange(total)
    counts = {"num_matches": 0, "num_refused": 0}
    if first:
        a, b, r = np.concatenate(first), np.concatenate(second), np.concatenate(trust)
        order = np.argsort(r, kind="stable")
        counts["num_matches"] = len(order)
        counts["num_refused"] = int(join(a[order], b[order], image, parent, len(keypoints)))
    root = roots(parent)
    root = root[canonical]
    node = np.arange(total)[canonical == np.arange(total)]
    root = root[node]
    length = np.bincount(root, minlength=total)
    node, root = node[length[root] >= min_length], root[length[root] >= min_length]
    # tracks are numbered by their first keypoint in image order
    _, track = np.unique(root, return_inverse=True)
    order = np.lexsort((node, track))
    node, track = node[order], track[order]
    all_xy = (
        np.concatenate([np.asarray(k, dtype=np.float64) for k in keypoints])
        if total
        else (np.zeros((0, 2)))
    )
    return (
        Observations(
            image_idx=image[node].astype(np.int64),
            track_idx=track.astype(np.int64),
            keypoint_idx=(node - offsets[image[node]]).astype(np.int64),
            xy=all_xy[node],
            num_images=len(keypoints),
            num_tracks=int(track.max()) + 1 if len(track) else 0,
        ),
        counts,
    )
