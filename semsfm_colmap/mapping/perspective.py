"""Perspective taken out of the observations, so that parallel projection holds for the rest.

Where the first model shows clearly that the rays are not parallel, cameras and points are found
anew: each round estimates kappa from the observations as they were seen, gives all observations as
parallel projection would show them, and filters and adjusts these like any. Points that parallel
projection had to reject come back on the way.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from semsfm_colmap.geometry.perspective import Perspective
from semsfm_colmap.geometry.points import track_pointer
from semsfm_colmap.geometry.subset import take_subset
from semsfm_colmap.geometry.triangulation import triangulate_tracks
from semsfm_colmap.mapping.context import SeriesContext
from semsfm_colmap.mapping.guided import camera_turn
from semsfm_colmap.records import PerspectiveFigures
from semsfm_colmap.refinement.adjustment import BundleSettings, comparing_solver
from semsfm_colmap.refinement.model_choice import total_rotation
from semsfm_colmap.refinement.perspective import (
    PerspectiveFit,
    find_principal_point,
    fit_perspective,
    without_perspective,
)
from semsfm_colmap.refinement.perspective_choice import (
    PerspectiveChoice,
    choose_perspective,
    kappa_sigma,
)
from semsfm_colmap.refinement.refine import Refined, refine
from semsfm_colmap.types import Float, Int, Observations, OrthographicCameras

MAX_ROUNDS = 8
PRINCIPAL_ROUNDS = (1, 3)
"""Rounds after which the principal point is looked for: when most of the points are back."""
PRINCIPAL_SHARE = 0.02
"""Standard deviation of the principal point from the middle of an image, in widths: cameras and
cropped images have 0.01 to 0.03."""
SETTLED_SHARE = 0.002
SETTLED_DEG = 0.005
"""Rounds end when kappa changes by a smaller share and the cameras turn by a smaller angle."""
NOTED_SHARE = 0.1
"""Perspective left in the observations is worth a sentence if it changes the total rotation by such
a share of its standard deviation."""
MIN_KEPT_SHARE = 0.9
"""Perspective is not taken out if fewer observations fit after it than this share."""
TRIANGULATION_PX = 8.0
"""Observations within so much give a track the depth that is used to straighten it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Straight:
    """A part whose observations are given as parallel projection would show them."""

    context: SeriesContext
    """with the magnifications' prior that a distance of its own for each image asks for"""
    refined: Refined
    observations: Observations
    """of the whole series"""
    perspective: Perspective
    """of the registered images"""
    figures: PerspectiveFigures
    """in the hand of the model"""


def judge_perspective(context: SeriesContext, refined: Refined) -> PerspectiveChoice | None:
    """Whether a model's observations show perspective."""
    options = context.refinement
    return choose_perspective(
        refined.cameras,
        refined.observations,
        principal_points(context)[refined.images],
        BundleSettings.of(options, refined.sigma_px, comparing_solver(options)),
    )


def straighten(
    context: SeriesContext,
    first: Refined,
    observations: Observations,
    *,
    rng: np.random.Generator,
) -> Straight | None:
    """Find perspective and take it out; None where it is not clear.

    Parameters
    ----------
    observations : of the whole series, as they were seen

    """
    if context.refinement.perspective == "off":
        return None
    choice = judge_perspective(context, first)
    if choice is None or not choice.clear:
        return None
    context.say(
        f"perspective: from {1 / choice.kappa:.0f} px ({1 / choice.kappa / choice.radius_px:.1f} "
        "radii of the specimen); it is taken out"
    )
    found = settle_perspective(context, first, observations, choice, rng=rng)
    if found is None:
        return None
    value, final = found.refined, found.fit
    if len(value.images) < len(first.images) or len(value.observations) < MIN_KEPT_SHARE * len(
        first.observations
    ):
        context.say("perspective: without it fewer observations fit, and it was left in")
        return None
    figures = replace(
        choice,
        kappa=final.kappa,
        sigma=kappa_sigma(final, found.used, value.sigma_px),
        radius_px=final.radius_px,
        change_deg=rotation_deg(value) - rotation_deg(first),
    ).figures(used=True)
    figures = replace(
        figures,
        principal_offset_px=found.principal_offset_px,
        principal_sigma_px=found.principal_sigma_px,
    )
    straight = replace(context.refinement, scale_sigma=final.scale_sigma)
    return Straight(
        context=replace(context, refinement=straight),
        refined=value,
        observations=found.observations,
        perspective=found.perspective,
        figures=figures,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Settling:
    """Where the rounds have come to."""

    refined: Refined
    """of observations without perspective"""
    observations: Observations
    """of the whole series, as parallel projection would show them"""
    perspective: Perspective
    """what was taken out"""
    used: Observations
    """the inliers as they were seen"""
    fit: PerspectiveFit
    """of these"""
    principal_offset_px: tuple[float, float]
    """from the middle of the images"""
    principal_sigma_px: float


def settle_perspective(
    context: SeriesContext,
    first: Refined,
    observations: Observations,
    choice: PerspectiveChoice,
    *,
    rng: np.random.Generator,
) -> Settling | None:
    """Rounds until kappa and cameras stay; None where one leaves nothing."""
    middle = principal_points(context)
    principal_sigma = PRINCIPAL_SHARE * float(np.mean(context.image_size_px[:, 0]))
    offset_px, sigma_px = np.zeros(2), principal_sigma
    value, fit, moved = first, choice.fit, observations
    settling: Settling | None = None
    for k in range(MAX_ROUNDS):
        options = replace(context.refinement, scale_sigma=fit.scale_sigma)
        points = all_points(fit.cameras, value.images, moved, context)
        view = Perspective(
            kappa=fit.kappa,
            centre=np.nanmedian(points, axis=0),
            principal_px=middle[value.images] + offset_px,
        )
        moved = moved_observations(observations, value.images, fit.cameras, points, view)
        refined = refine(
            fit.cameras,
            value.images,
            moved,
            options,
            rng=rng,
            seed=context.seed,
            series_idx=context.series_idx,
        ).value
        if refined is None:
            return None
        turned, value = camera_turn(value, refined), refined
        used = replace(value.observations, xy=observations.xy[value.inlier])
        settings = BundleSettings.of(context.refinement, value.sigma_px, comparing_solver(options))
        middle_px = middle[value.images]
        fit = fit_perspective(
            value.cameras, value.points, used, middle_px + offset_px, settings, kappa=fit.kappa
        )
        if k in PRINCIPAL_ROUNDS:
            point = find_principal_point(fit, used, middle_px, settings, principal_sigma)
            offset_px, sigma_px, fit = point.offset_px, point.sigma_px, point.fit
        settling = Settling(
            refined=value,
            observations=moved,
            perspective=replace(view, principal_px=middle[value.images] + offset_px),
            principal_offset_px=(float(offset_px[0]), float(offset_px[1])),
            principal_sigma_px=sigma_px,
            used=used,
            fit=fit,
        )
        settled = abs(fit.kappa - view.kappa) < SETTLED_SHARE * abs(fit.kappa)
        if k > 1 and settled and turned < np.deg2rad(SETTLED_DEG):
            break
    return settling


def rotation_deg(refined: Refined) -> float:
    """The largest rotation between two images of a model."""
    return float(np.rad2deg(total_rotation(np.asarray(refined.cameras.cam_from_world))))


def principal_points(context: SeriesContext) -> Float:
    """Where the optical axes are taken to meet the images, their middles: (M, 2) px."""
    return np.asarray(context.image_size_px, dtype=np.float64) / 2.0


def all_points(
    cameras: OrthographicCameras, images: Int, observations: Observations, context: SeriesContext
) -> Float:
    """Points of all tracks of the series, nan without one: (N, 3)."""
    local = take_subset(observations, images=images, min_length=2)
    obs = local.observations
    X, _ = triangulate_tracks(
        cameras.projection,
        np.asarray(cameras.translation_px),
        obs.image_idx,
        track_pointer(obs.track_idx, obs.num_tracks),
        obs.xy,
        threshold_px=TRIANGULATION_PX,
        trials=context.refinement.ransac_trials,
        seed=context.seed,
    )
    points = np.full((observations.num_tracks, 3), np.nan)
    points[local.tracks] = X
    return points


def moved_observations(
    observations: Observations,
    images: Int,
    cameras: OrthographicCameras,
    points: Float,
    perspective: Perspective,
) -> Observations:
    """The observations of the series as parallel projection would show them.

    Those in images without a camera, and of tracks without a point, stay.
    """
    number = np.full(observations.num_images, -1, dtype=np.int64)
    number[images] = np.arange(len(images))
    rows = number[observations.image_idx] >= 0
    some = observations.select(rows)
    local = replace(some, image_idx=number[some.image_idx], num_images=len(images))
    xy = np.array(observations.xy)
    xy[rows] = without_perspective(local, cameras, points, perspective).xy
    # as a COLMAP database will hold them
    return replace(observations, xy=xy.astype(np.float32).astype(np.float64))


def perspective_notes(figures: PerspectiveFigures | None, sigma_deg: float) -> list[str]:
    """What to say of the perspective of a part; `sigma_deg` of the total rotation."""
    f = figures
    if f is None or not (f.used or abs(f.change_deg) > NOTED_SHARE * sigma_deg):
        return []
    size = (
        f"the rays are not parallel: the images look as if seen from {abs(f.distance_px):.0f} px "
        f"({abs(f.distance_radii):.1f} radii of the specimen), which moves points by up to "
        f"{f.deviation_px:.1f} px at one radius"
    )
    if f.kappa_per_px < 0:
        size += (
            ", with far things larger than near ones: a lens or column that is hypercentric, or, "
            "if an ordinary camera took the images, the wrong hand"
        )
    if f.used:
        return [
            f"{size}; the observations are given as parallel projection would show them "
            f"(perspective), which changed the total rotation by {f.change_deg:+.2f} deg"
        ]
    return [
        f"{size}; the cameras written are those of parallel projection, with perspective the total "
        f"rotation would be {f.change_deg:+.3f} deg different (sigma {sigma_deg:.3f})"
    ]
