"""Series that could be taken: what each predicts; the cheapest that reach a wanted depth sigma.

The specimen is simulated (`synthetic.tracks`): points on a bumpy sphere or on a rough field,
cameras at even steps about one axis in the image, with half a degree of wobble.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from semsfm_colmap.errors import InputError
from semsfm_colmap.geometry.points import track_pointer
from semsfm_colmap.geometry.subset import take_subset
from semsfm_colmap.geometry.triangulation import triangulation_angle
from semsfm_colmap.planning.options import NoiseOptions, SpecimenOptions
from semsfm_colmap.planning.prediction import Geometry, Prediction, predict
from semsfm_colmap.refinement.options import RefinementOptions
from semsfm_colmap.synthetic.tracks import simulate_tracks
from semsfm_colmap.types import Bool, Float, Observations

TOTALS_DEG = (10.0, 20.0, 30.0, 45.0, 60.0, 90.0, 120.0, 180.0, 270.0, 360.0)
"""Total angles that are tried."""
SAMPLE_POINTS = 1200
"""Points whose depths are predicted; each stands for its share of all points."""
MIN_SAMPLE = 12
"""Fewer points that three images see do not hold a model together."""
WOBBLE_DEG = 0.5
CURVE_POINTS = 5
"""Series of each total angle in a figure."""
FRAME_SHARE = 0.8
"""Share of the height of a frame that the specimen fills."""


@dataclass(frozen=True, kw_only=True)
class SeriesSize:
    """How a series is taken: at even steps."""

    num_frames: int
    total_deg: float
    """from the first image to the last; 360: the turn closes with a step from the last to it"""

    @property
    def step_deg(self) -> float:
        """Between neighbouring images."""
        return self.total_deg / (self.num_frames - (0 if self.is_turn else 1))

    @property
    def is_turn(self) -> bool:
        """Whether the turn closes."""
        return self.total_deg >= 360.0

    @property
    def range_deg(self) -> float:
        """From the first image to the last."""
        return self.step_deg * (self.num_frames - 1)


@dataclass(frozen=True, kw_only=True, eq=False)
class PlannedSeries:
    """A series with its predicted error bars."""

    size: SeriesSize
    prediction: Prediction
    seen_share: float
    """Share of the specimen's points that three images see"""


def planned_geometry(
    size: SeriesSize,
    specimen: SpecimenOptions,
    noise: NoiseOptions,
    *,
    num_sampled: int = SAMPLE_POINTS,
    seed: int = 0,
) -> Geometry | None:
    """Who would see what of the specimen; None where three images see hardly a point.

    Parameters
    ----------
    num_sampled : points on the specimen that are simulated

    """
    simulated = simulate_tracks(
        num_images=size.num_frames,
        range_deg=size.range_deg,
        num_tracks=num_sampled,
        noise_px=0.0,
        body=specimen.specimen,
        radius_px=specimen.size_px / 2.0,
        wobble_deg=WOBBLE_DEG,
        visible_deg=noise.visible_deg,
        rng=np.random.default_rng(seed),
    )
    cameras, obs = simulated.cameras, simulated.observations
    kept = take_subset(obs, mask=determined(obs, cameras.viewing_direction))
    if len(kept.tracks) < MIN_SAMPLE:
        return None
    points = simulated.points[kept.tracks]
    normals = np.tile([0.0, 0.0, -1.0], (len(points), 1))
    if specimen.specimen == "body":
        normals = points / np.linalg.norm(points, axis=1, keepdims=True)
    return Geometry(
        cameras=cameras,
        points=points,
        normals=normals,
        observations=kept.observations,
        height_px=specimen.size_px / FRAME_SHARE,
        points_per_point=specimen.num_points / num_sampled,
    )


def determined(observations: Observations, direction: Float) -> Bool:
    """(O,) False of tracks that the mapping stage would leave out."""
    options = RefinementOptions()
    pointer = track_pointer(observations.track_idx, observations.num_tracks)
    inside = np.ones(len(observations), dtype=bool)
    angle = triangulation_angle(direction, observations.image_idx, pointer, inside)
    long = np.diff(pointer) >= options.min_track_length
    wide = angle >= math.radians(options.min_triangulation_angle_deg)
    return np.asarray((long & wide)[observations.track_idx])


def plan_series(
    size: SeriesSize, specimen: SpecimenOptions, noise: NoiseOptions
) -> PlannedSeries | None:
    """Predict one series; None where its images leave something undetermined."""
    geometry = planned_geometry(size, specimen, noise)
    if geometry is None:
        return None
    prediction = predict(geometry, noise)
    if prediction is None:
        return None
    return PlannedSeries(
        size=size,
        prediction=prediction,
        seen_share=len(geometry.points) / SAMPLE_POINTS,
    )


def fewest_frames(total_deg: float, specimen: SpecimenOptions) -> int:
    """The fewest images over a total angle whose steps are not too large."""
    steps = math.ceil(total_deg / specimen.max_step_deg - 1e-9)
    return max(3, steps if total_deg >= 360.0 else steps + 1)


def totals_deg(specimen: SpecimenOptions, noise: NoiseOptions) -> list[float]:
    """The total angles to be tried: up to the limit, and of a field while any point is seen."""
    limit = specimen.max_total_deg
    if specimen.specimen == "field":
        limit = min(limit, 2.0 * noise.visible_deg)
    below = [total for total in TOTALS_DEG if total < limit]
    return [*below, limit]


def alternatives(
    depth_sigma_px: float, specimen: SpecimenOptions, noise: NoiseOptions
) -> list[PlannedSeries]:
    """The fewest images for each total angle that reach a median depth sigma; cheapest first.

    The sigma falls with the number of images, which is found by bisection.
    """
    found = []
    for total in totals_deg(specimen, noise):
        series = _fewest_that_reach(depth_sigma_px, total, specimen, noise)
        if series is not None:
            found.append(series)
    return sorted(found, key=lambda s: (s.size.num_frames, s.size.total_deg))


def _fewest_that_reach(
    depth_sigma_px: float, total_deg: float, specimen: SpecimenOptions, noise: NoiseOptions
) -> PlannedSeries | None:
    low, high = fewest_frames(total_deg, specimen), specimen.max_frames
    if low > high:
        return None

    def reached(num_frames: int) -> PlannedSeries | None:
        size = SeriesSize(num_frames=num_frames, total_deg=total_deg)
        series = plan_series(size, specimen, noise)
        return series if series and series.prediction.median_px <= depth_sigma_px else None

    best = reached(low)
    if best is not None:
        return best
    best = reached(high)
    while best is not None and high - low > 1:
        middle = (low + high) // 2
        series = reached(middle)
        low, high, best = (low, middle, series) if series else (middle, high, best)
    return best


def best_within_limits(specimen: SpecimenOptions, noise: NoiseOptions) -> PlannedSeries:
    """The series of most images with the smallest median depth sigma.

    Raises
    ------
    InputError : no series within the limits makes a model

    """
    sizes = [
        SeriesSize(num_frames=specimen.max_frames, total_deg=total)
        for total in totals_deg(specimen, noise)
        if fewest_frames(total, specimen) <= specimen.max_frames
    ]
    planned = [series for size in sizes if (series := plan_series(size, specimen, noise))]
    if not planned:
        raise InputError(
            "no series within these limits determines a model: allow a larger total angle "
            "(--max_total_deg), more images (--max_frames) or larger steps (--max_step_deg)"
        )
    return min(planned, key=lambda series: series.prediction.median_px)


def curves(specimen: SpecimenOptions, noise: NoiseOptions) -> dict[float, list[PlannedSeries]]:
    """Series of different numbers of images, for each total angle, for a figure."""
    found: dict[float, list[PlannedSeries]] = {}
    for total in totals_deg(specimen, noise):
        least = fewest_frames(total, specimen)
        if least <= specimen.max_frames:
            frames = np.unique(np.geomspace(least, specimen.max_frames, CURVE_POINTS).round())
            sizes = [SeriesSize(num_frames=int(n), total_deg=total) for n in frames]
            found[total] = [s for size in sizes if (s := plan_series(size, specimen, noise))]
    return found
