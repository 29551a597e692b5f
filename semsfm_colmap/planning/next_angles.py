"""Which images to add to a series: the angles that lower the depth sigmas of its points most.

Greedy: of all candidate angles about the axis of the series, the one whose image lowers the mean
(or the worst) depth sigma most is taken, and the search goes on from the series that has it. Every
candidate is predicted in full (`prediction`), with the poses, magnification and drift of its image
unknown. It may show the points of the model whose normals lie near its direction of view, but a
match is not found of every one: with p the share that the images of the series have of theirs, each
such observation counts p. What hides behind other parts, and surface that only the new image would
show, is not known.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.geometry.points import track_pointer
from semsfm_colmap.geometry.rotations import rotation_from_vector, wrapped
from semsfm_colmap.geometry.subset import take_exactly, take_subset
from semsfm_colmap.motion.axis import AxisRotation, fit_axis
from semsfm_colmap.planning.options import Criterion, GivenNoise, NextOptions, NoiseOptions
from semsfm_colmap.planning.prediction import Geometry, Prediction, predict
from semsfm_colmap.planning.series import MIN_SAMPLE, SAMPLE_POINTS, determined
from semsfm_colmap.refinement.drag import MIN_POINTS, seen_normals
from semsfm_colmap.refinement.noise import noise_sigma
from semsfm_colmap.types import Bool, Float, OrthographicCameras, Reconstruction

MARGIN_DEG = 30.0
"""How far beyond the series candidates are tried by default."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MappedSeries:
    """A series that exists, as the prediction takes it."""

    geometry: Geometry
    """of a sample of its points"""
    axis: AxisRotation
    image_names: tuple[str, ...]
    noise: NoiseOptions
    """given, or what its residuals show and it was mapped with"""
    matched_share: float
    """p of the module's text"""


@dataclass(frozen=True, kw_only=True, eq=False)
class AddedImage:
    """An image to be added, and the error bars with it and all before it."""

    angle_deg: float
    nearest: str
    """the image of the series that lies nearest"""
    from_nearest_deg: float
    prediction: Prediction


@dataclass(frozen=True, kw_only=True, eq=False)
class NextAngles:
    """The answer: images in the order of their use."""

    before: Prediction
    added: tuple[AddedImage, ...]
    tried_deg: Float
    """(K,) angles of the first search"""
    tried_px: Float
    """(K,) what the criterion would be with each; nan where it is too far or sees hardly a point"""


def mapped_series(
    reconstruction: Reconstruction, given: GivenNoise, priors: NoiseOptions, seed: int = 0
) -> MappedSeries:
    """A model as a geometry of some of its points, each for its share of all.

    Parameters
    ----------
    given : goes before the noise that the residuals show, and before the priors
    priors : those that the model was mapped with

    Raises
    ------
    InputError : too few points, or nothing turns

    """
    cameras = reconstruction.cameras
    axis = fit_axis(np.asarray(cameras.cam_from_world))
    if axis is None:
        raise InputError("nothing turns in this model: there is no axis to add angles about")
    unit = cameras.mean_scale_px_per_unit
    cameras = replace(cameras, scale_px_per_unit=cameras.scale_px_per_unit / unit)
    inside = reconstruction.inlier
    obs = reconstruction.observations.select(inside)
    subset = take_subset(obs, mask=determined(obs, cameras.viewing_direction))
    if len(subset.tracks) < MIN_POINTS:
        raise InputError(
            f"the model has {len(subset.tracks)} points that three images see; {MIN_POINTS} are "
            "needed to know its surface: map the series with more matches first"
        )
    points = reconstruction.points[subset.tracks] * unit
    residual = reconstruction.residuals()[inside][subset.rows]
    obs = subset.observations
    pointer = track_pointer(obs.track_idx, obs.num_tracks)
    sigma_px = noise_sigma(residual, obs.precision, pointer, len(cameras))
    noise = given.over(replace(priors, noise_px=sigma_px))
    normals = seen_normals(points, cameras, obs)
    share = min(SAMPLE_POINTS, len(points))
    some = np.sort(np.random.default_rng(seed).choice(len(points), share, replace=False))
    sample = take_exactly(obs, np.arange(len(cameras)), some).observations
    xy = cameras.project(points[some][sample.track_idx], sample.image_idx)
    faced = facing(normals[some], np.asarray(cameras.cam_from_world), noise.visible_deg)
    matched = faced[sample.track_idx, sample.image_idx]
    if not matched.any():
        raise InputError(
            f"no image sees a point within {noise.visible_deg:g} degrees of its normal: allow more "
            "(--visible_deg)"
        )
    return MappedSeries(
        geometry=Geometry(
            cameras=cameras,
            points=points[some],
            normals=normals[some],
            observations=replace(sample, xy=xy),
            height_px=float(np.mean(reconstruction.image_size_px[:, 1])),
            points_per_point=len(points) / share,
        ),
        matched_share=float(matched.sum()) / float(faced.sum()),
        axis=axis,
        image_names=reconstruction.image_names,
        noise=noise,
    )


def next_angles(series: MappedSeries, options: NextOptions) -> NextAngles:
    """The angles to add, by greedy search.

    Raises
    ------
    UsageError : no angles to try
    InputError : the error bars of the series are not determined

    """
    candidates = candidate_angles(series.axis, options)
    geometry = series.geometry
    before = predict(geometry, series.noise)
    if before is None:
        raise InputError(
            "some poses of this model are not determined by its points: no error bars can be given"
        )
    added: list[AddedImage] = []
    first = np.full(len(candidates), np.nan)
    for turn in range(options.num_added):
        value = np.full(len(candidates), np.nan)
        best: tuple[Geometry, Prediction] | None = None
        there = np.append(np.rad2deg(series.axis.angle_rad), [image.angle_deg for image in added])
        for k, angle in enumerate(candidates):
            if np.abs(wrapped(angle - there, 360.0)).min() > options.max_from_nearest_deg:
                continue
            with_it = with_image(geometry, series, angle)
            found = None if with_it is None else predict(with_it, series.noise)
            if with_it is None or found is None:
                continue
            value[k] = criterion_px(found, options.criterion)
            if value[k] <= np.nanmin(value):
                best, chosen = (with_it, found), float(angle)
        if turn == 0:
            first = value
        if best is None:
            raise InputError(
                "no angle that is tried lies near enough to an image and sees the model: change "
                "--from_deg and --to_deg, or allow more with --max_from_nearest_deg"
            )
        geometry, prediction = best
        nearest, apart = _nearest(series.axis, chosen)
        added.append(
            AddedImage(
                angle_deg=chosen,
                nearest=series.image_names[nearest],
                from_nearest_deg=apart,
                prediction=prediction,
            )
        )
    return NextAngles(before=before, added=tuple(added), tried_deg=candidates, tried_px=first)


def criterion_px(prediction: Prediction, criterion: Criterion) -> float:
    """What the images added shall lower."""
    return prediction.mean_px if criterion == "mean" else prediction.worst_px


def candidate_angles(axis: AxisRotation, options: NextOptions) -> Float:
    """Angles (K,) deg to be tried, from the first image about the axis; less than a turn."""
    angle = np.rad2deg(axis.angle_rad)
    low = float(angle.min()) - MARGIN_DEG if options.from_deg is None else options.from_deg
    high = float(angle.max()) + MARGIN_DEG if options.to_deg is None else options.to_deg
    if not low < high:
        raise UsageError(f"--from_deg {low:g} is not below --to_deg {high:g}: nothing can be tried")
    step = options.candidate_step_deg
    tried = np.arange(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1) * step
    tried = tried[tried < tried[:1].sum() + 360.0]
    if not len(tried):
        raise UsageError(
            f"no multiple of {step:g} degrees lies from {low:g} to {high:g}: give a smaller "
            "--candidate_step_deg"
        )
    return np.asarray(tried, dtype=np.float64)


def facing(normals: Float, cam_from_world: Float, visible_deg: float) -> Bool:
    """Which points (N,) lie within an angle of their normals to which images (M,): (N, M)."""
    toward = -normals @ cam_from_world[:, 2].T
    return np.asarray(toward >= math.cos(math.radians(visible_deg)))


def _nearest(axis: AxisRotation, angle_deg: float) -> tuple[int, float]:
    """The image nearest to an angle, and the angle from it, deg."""
    apart = wrapped(angle_deg - np.rad2deg(axis.angle_rad), 360.0)
    nearest = int(np.argmin(np.abs(apart)))
    return nearest, float(apart[nearest])


def with_image(geometry: Geometry, series: MappedSeries, angle_deg: float) -> Geometry | None:
    """The geometry with one more image; None where that would see hardly a point.

    It is the nearest image of the series, turned about the axis, its points' centroid in place.
    """
    nearest, apart = _nearest(series.axis, angle_deg)
    old = geometry.cameras
    turn = rotation_from_vector(np.deg2rad(apart) * series.axis.axis_camera)
    R = turn @ np.asarray(old.cam_from_world)[nearest]
    seen = np.flatnonzero(facing(geometry.normals, R[None], series.noise.visible_deg)[:, 0])
    if len(seen) < MIN_SAMPLE:
        return None
    centroid = geometry.points.mean(axis=0)
    place = old.project(centroid[None], np.array([nearest]))[0]
    M = len(old)
    cameras: OrthographicCameras = replace(
        old,
        cam_from_world=np.concatenate([old.cam_from_world, R[None]]),
        scale_px_per_unit=np.append(old.scale_px_per_unit, 1.0),
        translation_px=np.concatenate(
            [old.translation_px, (place - old.K2 @ R[:2] @ centroid)[None]]
        ),
    )
    obs = geometry.observations
    image_idx = np.append(obs.image_idx, np.full(len(seen), M))
    track_idx = np.append(obs.track_idx, seen)
    own = cameras.project(geometry.points[seen], image_idx[len(obs) :])
    relative = np.ones(len(obs)) if obs.relative_sigma is None else obs.relative_sigma
    new = np.full(len(seen), 1.0 / math.sqrt(series.matched_share))
    together = replace(
        obs,
        image_idx=image_idx,
        track_idx=track_idx,
        keypoint_idx=np.append(obs.keypoint_idx, np.full(len(seen), -1)),
        xy=np.concatenate([obs.xy, own]),
        relative_sigma=np.append(relative, new),
        num_images=M + 1,
    )
    return replace(
        geometry,
        cameras=cameras,
        observations=together.select(np.argsort(track_idx, kind="stable")),
    )
