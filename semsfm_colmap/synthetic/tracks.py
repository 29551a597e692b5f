"""Simulated tracks without images: for tests of the geometry and for benchmarks.

Points on a body or a field, cameras on a turn or a tilt, each point seen in a window of frames on
the side it faces, Gaussian noise, a share of wrong matches.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from semsfm_colmap.geometry.perspective import Perspective
from semsfm_colmap.geometry.rotations import rotation_from_vector
from semsfm_colmap.types import Bool, Float, Observations, OrthographicCameras


@dataclass(frozen=True, kw_only=True, eq=False)
class SimulatedTracks:
    """Observations with the truth they were made from."""

    cameras: OrthographicCameras
    points: Float
    observations: Observations
    correct: Bool
    """(O,) False where a wrong match was put in"""


def simulate_tracks(
    *,
    num_images: int,
    range_deg: float,
    num_tracks: int,
    noise_px: float = 0.3,
    outlier_share: float = 0.0,
    track_window: int = 0,
    body: str = "body",
    radius_px: float = 400.0,
    scale_drift: float = 0.0,
    wobble_deg: float = 1.0,
    visible_deg: float | None = None,
    rng: np.random.Generator,
) -> SimulatedTracks:
    """A series turning about an axis near y.

    Parameters
    ----------
    track_window : longest run of frames in which a point is seen; 0 for no limit
    body : "body" (points on a bumpy sphere, seen on the side that faces the viewer) or "field"
        (a rough surface around z = 0, all seen)
    scale_drift : relative standard deviation of the magnification per image
    visible_deg : a point is seen within this angle of its normal; None: 78 degrees on a body,
        always on a field

    """
    angles = np.deg2rad(np.linspace(-range_deg / 2, range_deg / 2, num_images))
    axis = np.array([0.02, 1.0, 0.03])
    axis /= np.linalg.norm(axis)
    wobble = np.deg2rad(wobble_deg) * rng.normal(size=(num_images, 3))
    R = rotation_from_vector(wobble) @ rotation_from_vector(angles[:, None] * axis)
    scale = np.exp(scale_drift * rng.normal(size=num_images))
    t = 500.0 + 20.0 * rng.normal(size=(num_images, 2))
    if body == "body":
        normal = rng.normal(size=(num_tracks, 3))
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        points = normal * radius_px * (1.0 + 0.15 * rng.normal(size=(num_tracks, 1)))
        facing = (normal @ R[:, 2].T) < -0.2  # (N, M)
    else:
        points = rng.uniform(-radius_px, radius_px, size=(num_tracks, 3)) * [1.0, 1.0, 0.15]
        normal = np.array([[0.0, 0.0, -1.0]])
        facing = np.ones((num_tracks, num_images), dtype=bool)
    if visible_deg is not None:
        toward = -normal @ R[:, 2].T >= np.cos(np.deg2rad(visible_deg))
        facing = np.broadcast_to(toward, facing.shape).copy()
    if track_window:
        # a window around a random one of the frames that face the point
        score = np.where(facing, rng.random((num_tracks, num_images)), -1.0)
        centre = score.argmax(axis=1)
        frames = np.arange(num_images)
        first = centre - rng.integers(0, track_window, num_tracks)
        inside = (frames >= first[:, None]) & (frames < first[:, None] + track_window)
        facing &= inside
    facing &= (facing.sum(axis=1) >= 2)[:, None]
    track_idx, image_idx = np.nonzero(facing)
    used, track_idx = np.unique(track_idx, return_inverse=True)
    points = points[used]
    cameras = OrthographicCameras(cam_from_world=R, scale_px_per_unit=scale, translation_px=t)
    xy = cameras.project(points[track_idx], image_idx)
    xy = xy + noise_px * rng.normal(size=xy.shape)
    wrong = rng.random(len(xy)) < outlier_share
    xy[wrong] += rng.uniform(-60.0, 60.0, size=(int(wrong.sum()), 2))
    observations = Observations(
        image_idx=image_idx,
        track_idx=track_idx,
        keypoint_idx=np.arange(len(track_idx)),
        xy=xy,
        num_images=num_images,
        num_tracks=len(points),
    )
    return SimulatedTracks(
        cameras=cameras, points=points, observations=observations, correct=~wrong
    )


def seen_in_perspective(
    simulated: SimulatedTracks,
    kappa: float,
    principal_px: float,
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> SimulatedTracks:
    """The same tracks as a pinhole camera of focal length 1 / kappa px shows them; same noise.

    Parameters
    ----------
    principal_px : both coordinates of the place where the optical axis meets the images
    centre : the point of the world that stands 1 / kappa px away in each image

    """
    obs, M = simulated.observations, len(simulated.cameras)
    view = Perspective(
        kappa=kappa, centre=np.array(centre), principal_px=np.full((M, 2), principal_px)
    )
    X = simulated.points[obs.track_idx]
    q = simulated.cameras.project(X, obs.image_idx)
    seen = view.seen(q, view.depth(simulated.cameras, X, obs.image_idx), obs.image_idx)
    return replace(simulated, observations=replace(obs, xy=obs.xy + seen - q))
