"""Keypoints and matches that the guided pass adds to those of the database."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy import sparse

from semsfm_colmap.mapping.finish import MappedPart
from semsfm_colmap.types import Float, Int


def append_keypoints(
    parts: Sequence[MappedPart], keypoints: Mapping[str, Float]
) -> tuple[list[MappedPart], dict[str, Float]]:
    """Give the observations of guided parts keypoints of their own, after the measured ones.

    Returns
    -------
    The parts with renumbered `keypoint_idx`, and (K', 2) px of each image

    """
    extended = dict(keypoints)
    result = []
    for part in parts:
        if not part.guided:
            if part.moved:
                extended |= moved_keypoints(part, extended)
            result.append(part)
            continue
        obs = part.reconstruction.observations
        numbers: Int = np.empty(len(obs), dtype=np.int64)
        for i, name in enumerate(part.reconstruction.image_names):
            rows = np.flatnonzero(obs.image_idx == i)
            numbers[rows] = len(extended[name]) + np.arange(len(rows))
            extended[name] = np.concatenate([extended[name], obs.xy[rows]])
        observations = replace(obs, keypoint_idx=numbers)
        twin = part.twin
        result.append(
            replace(
                part,
                reconstruction=replace(part.reconstruction, observations=observations),
                twin=None if twin is None else replace(twin, observations=observations),
            )
        )
    return result, extended


def moved_keypoints(part: MappedPart, keypoints: Mapping[str, Float]) -> dict[str, Float]:
    """The keypoints of a part's images, those observed where parallel projection shows them."""
    r = part.reconstruction
    moved = {}
    for i, name in enumerate(r.image_names):
        rows = np.flatnonzero(r.observations.image_idx == i)
        moved[name] = np.array(keypoints[name], dtype=np.float64)
        moved[name][r.observations.keypoint_idx[rows], :2] = r.observations.xy[rows]
    return moved


def guided_matches(parts: Sequence[MappedPart], min_num_matches: int) -> dict[tuple[str, str], Int]:
    """Inlier matches (L, 2) of keypoints between all pairs of images that share enough points."""
    matches: dict[tuple[str, str], Int] = {}
    for part in parts:
        if not part.guided:
            continue
        r = part.reconstruction
        obs = r.observations.select(r.inlier)
        seen = sparse.csr_array(
            (np.ones(len(obs), dtype=np.int32), (obs.image_idx, obs.track_idx)),
            shape=(obs.num_images, obs.num_tracks),
        )
        shared = sparse.triu(seen @ seen.T, k=1).tocoo()
        rows = [np.flatnonzero(obs.image_idx == i) for i in range(obs.num_images)]
        enough = shared.data >= min_num_matches
        for i, j in zip(shared.row[enough], shared.col[enough], strict=True):
            _, a, b = np.intersect1d(
                obs.track_idx[rows[i]],
                obs.track_idx[rows[j]],
                assume_unique=True,
                return_indices=True,
            )
            matches[r.image_names[i], r.image_names[j]] = np.column_stack(
                [obs.keypoint_idx[rows[i][a]], obs.keypoint_idx[rows[j][b]]]
            )
    return matches
