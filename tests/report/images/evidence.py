"""Evidence of the closed-form series: keypoints at its observations, matches of neighbours."""

from __future__ import annotations

import numpy as np

from semsfm_colmap.records import MATCH_STEPS
from semsfm_colmap.report.images.evidence import ImageEvidence, PairEvidence, SeriesEvidence
from semsfm_colmap.types import DepthMap, Reconstruction
from tests.report.series import SIZE_PX

VERIFIED = len(MATCH_STEPS) - 1


def make_evidence(rec: Reconstruction, *, seed: int = 0, reach: int = 1) -> SeriesEvidence:
    """Each observation is a keypoint of scale 3; neighbours share the matches of their tracks.

    The observations' keypoint numbers have to be those of their images: see `numbered`.
    """
    rng = np.random.default_rng(seed)
    obs = rec.observations
    images, track_of = {}, {}
    for i, name in enumerate(rec.image_names):
        rows = np.flatnonzero(obs.image_idx == i)
        keypoints = np.zeros((len(rows), 4), dtype=np.float32)
        keypoints[obs.keypoint_idx[rows]] = np.column_stack(
            [obs.xy[rows], np.full(len(rows), 3.0), rng.uniform(-3.0, 3.0, len(rows))]
        )
        images[name] = ImageEvidence(keypoints=keypoints, in_track=np.ones(len(rows), dtype=bool))
        track_of[name] = dict(
            zip(obs.track_idx[rows].tolist(), obs.keypoint_idx[rows].tolist(), strict=True)
        )
    pairs = []
    for i, a in enumerate(rec.image_names):
        for b in rec.image_names[i + 1 : i + 1 + reach]:
            both = sorted(track_of[a].keys() & track_of[b].keys())
            if both:
                matches = np.array([(track_of[a][t], track_of[b][t]) for t in both])
                pairs.append(
                    PairEvidence(names=(a, b), matches=matches, step=np.full(len(both), VERIFIED))
                )
    gradient = np.add.outer(np.arange(SIZE_PX[1]), np.arange(SIZE_PX[0]))
    depth = np.where(gradient > 300, gradient / 100.0, np.nan).astype(np.float32)

    def depth_map(name: str) -> DepthMap | None:
        if name == rec.image_names[-1]:
            return None
        return DepthMap(image_name=name, depth=depth, sigma=0.01 * depth)

    return SeriesEvidence(
        read_pixels=lambda name: (gradient % 256).astype(np.uint8),
        images=images,
        pairs=tuple(pairs),
        tracks=obs,
        track_names=rec.image_names,
        read_depth_map=depth_map,
    )


def numbered(rec: Reconstruction) -> Reconstruction:
    """The same with keypoint numbers that count up within each image."""
    from dataclasses import replace

    obs = rec.observations
    number = np.zeros(len(obs), dtype=np.int64)
    for i in range(rec.num_images):
        rows = np.flatnonzero(obs.image_idx == i)
        number[rows] = np.arange(len(rows))
    return replace(rec, observations=replace(obs, keypoint_idx=number))
