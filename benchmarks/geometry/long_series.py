"""A turn in many frames."""

from __future__ import annotations

import numpy as np

from benchmarks.geometry.series import NOISE_PX
from semsfm_colmap.geometry.rotations import rotation_from_vector
from semsfm_colmap.synthetic.tracks import SimulatedTracks
from semsfm_colmap.types import Observations, OrthographicCameras

TRACK_SPAN_DEG = 30.0
"""Rotation that a track lasts, or as many frames as it has observations if that is more."""


def long_series(
    frames: int, tracks: int, length: int, seed: int = 0, span_deg: float = TRACK_SPAN_DEG
) -> SimulatedTracks:
    """A turn, tracks of a fixed length, made without a dense visibility matrix.

    Fine steps do not make tracks last longer in degrees: a track has its observations in some of
    the frames of a run of `span_deg`, or in a run of as many frames as it has observations.
    """
    rng = np.random.default_rng(seed)
    angles = 2.0 * np.pi * np.arange(frames) / frames
    R = rotation_from_vector(0.01 * rng.normal(size=(frames, 3))) @ rotation_from_vector(
        angles[:, None] * np.array([0.0, 1.0, 0.0])
    )
    cameras = OrthographicCameras(
        cam_from_world=R,
        scale_px_per_unit=np.exp(0.0005 * rng.normal(size=frames)),
        translation_px=600.0 + 20.0 * rng.normal(size=(frames, 2)),
    )
    window = max(length, round(frames * span_deg / 360.0))
    first = rng.integers(0, frames, tracks)
    # the point faces the middle of its window
    middle = angles[(first + window // 2) % frames]
    radius = 400.0 * (1.0 + 0.1 * rng.normal(size=tracks))
    side = middle + 0.5 * rng.normal(size=tracks)
    points = np.column_stack(
        [radius * np.sin(side), rng.uniform(-400, 400, tracks), -radius * np.cos(side)]
    )
    track_idx = np.repeat(np.arange(tracks), length)
    image_idx = np.empty((tracks, length), dtype=np.int64)
    xy = np.empty((len(track_idx), 2))
    for begin in range(0, tracks, 100_000):
        some = slice(begin, min(begin + 100_000, tracks))
        num = some.stop - some.start
        picked = rng.random((num, window)).argpartition(length - 1, axis=1)[:, :length]
        image_idx[some] = np.sort((first[some, None] + picked) % frames, axis=1)
        rows = slice(some.start * length, some.stop * length)
        xy[rows] = cameras.project(points[track_idx[rows]], image_idx[some].ravel())
    xy += NOISE_PX * rng.normal(size=xy.shape)
    observations = Observations(
        image_idx=image_idx.ravel(),
        track_idx=track_idx,
        keypoint_idx=np.arange(len(track_idx)),
        xy=xy,
        num_images=frames,
        num_tracks=tracks,
    )
    return SimulatedTracks(
        cameras=cameras,
        points=points,
        observations=observations,
        correct=np.ones(len(track_idx), dtype=bool),
    )
