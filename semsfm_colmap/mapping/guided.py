"""The guided second pass: every point is looked for in every image, until the cameras settle."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from semsfm_colmap.geometry.alignment import align_rotations
from semsfm_colmap.geometry.rotations import rotation_angle
from semsfm_colmap.geometry.subset import take_subset
from semsfm_colmap.mapping.context import Guide, SeriesContext
from semsfm_colmap.mapping.drift import adjust_last
from semsfm_colmap.matching.guided.filtering import FilteredImages
from semsfm_colmap.matching.guided.grow import Grown, grow_tracks
from semsfm_colmap.matching.guided.noise import fit_relative_sigma
from semsfm_colmap.records import GuidedFigures
from semsfm_colmap.refinement.displaced import Displacement
from semsfm_colmap.refinement.noise import expected_share
from semsfm_colmap.refinement.refine import Refined, refine
from semsfm_colmap.types import Observations

SETTLED_GROWTH = 1.2
"""A pass that multiplies the observations by more calls for another."""
MIN_KEPT_SHARE = 0.9
"""A pass that leaves fewer observations than this share is not an improvement."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Guided:
    """A part after its second pass."""

    refined: Refined
    observations: Observations
    """of the whole series' images; `keypoint_idx` counts from 0 within each image"""
    displacement: Displacement
    """what was taken out of the observations"""
    figures: GuidedFigures


@dataclass(frozen=True, kw_only=True, eq=False)
class Settling:
    """Where the passes have come to: the last one's observations and the cameras they gave."""

    refined: Refined
    grown: Grown
    num_passes: int


def refine_guided(
    context: SeriesContext,
    guide: Guide,
    first: Refined,
    observations: Observations,
    *,
    rng: np.random.Generator,
) -> Guided | None:
    """Align the known observations, then look for every point everywhere; adjust after each.

    Returns
    -------
    None when the pass finds less than there was: blurred images, too few points

    """
    settled = settle(context, guide, first, observations, rng=rng)
    if settled is None or len(settled.refined.observations) < MIN_KEPT_SHARE * len(
        first.observations
    ):
        return None
    value, grown = settled.refined, settled.grown
    found = with_own_sigma(grown, value) if guide.options.own_weights else grown.observations
    end = adjust_last(context, value, found)
    last = end.refined
    return Guided(
        refined=last,
        observations=end.observations,
        displacement=end.displacement,
        figures=GuidedFigures(
            num_passes=settled.num_passes,
            high_pass_px=grown.high_pass_px,
            num_places=grown.num_predicted,
            num_found=len(grown.observations),
            num_observations_before=len(first.observations),
            num_observations=len(last.observations),
            mean_track_length_before=len(first.observations) / max(len(first.tracks), 1),
            mean_track_length=len(last.observations) / max(len(last.tracks), 1),
            sigma_before_px=first.sigma_px,
            sigma_px=last.sigma_px,
            largest_drift_px=float(np.abs(end.displacement.drift_px).max(initial=0.0)),
        ),
    )


def settle(
    context: SeriesContext,
    guide: Guide,
    first: Refined,
    observations: Observations,
    *,
    rng: np.random.Generator,
) -> Settling | None:
    """Passes until the cameras no longer turn; None where one gives no model of all images."""
    value, seeds = first, observations
    settled: Settling | None = None
    rounds = guide.options.rounds
    filtered = FilteredImages(guide.read_image)
    for k in range(rounds):

        def looked(done: int, total: int, k: int = k) -> None:
            context.progress("guided passes", k * total + done, rounds * total)

        step = grow_part(
            value, seeds, guide, filtered, extend=k > 0, seed=context.seed, progress=looked
        )
        if step is None:
            return None
        adjusted = refine(
            value.cameras,
            value.images,
            step.observations,
            context.refinement,
            rng=rng,
            seed=context.seed,
            series_idx=context.series_idx,
        ).value
        if adjusted is None or len(adjusted.images) < len(first.images):
            return None
        turned = camera_turn(value, adjusted)
        growth = len(adjusted.observations) / max(len(value.observations), 1)
        value = adjusted
        settled = Settling(refined=value, grown=step, num_passes=k + 1)
        context.say(
            f"guided pass {k + 1}: structure finer than {step.high_pass_px:g} px, "
            f"{len(step.observations)} of {step.num_predicted} places found, "
            f"{len(value.tracks)} points, {len(value.observations)} observations, "
            f"sigma {value.sigma_px:.3f} px, cameras turned by {np.rad2deg(turned):.3f} deg"
        )
        if k > 0:
            seeds = step.observations
            if turned < np.deg2rad(guide.options.converged_deg) and growth < SETTLED_GROWTH:
                break
    return settled


def camera_turn(before: Refined, after: Refined) -> float:
    """Root mean square angle by which an adjustment turned the cameras, rad, but for a common one.

    Infinite where it registered other images.
    """
    if not np.array_equal(before.images, after.images):
        return float("inf")
    old, new = before.cameras.cam_from_world, after.cameras.cam_from_world
    back = np.swapaxes(old, 1, 2)
    turn = rotation_angle(new @ align_rotations(new, old) @ back)
    return float(np.sqrt(np.mean(turn**2)))


def grow_part(
    value: Refined,
    observations: Observations,
    guide: Guide,
    filtered: FilteredImages,
    *,
    extend: bool,
    seed: int,
    progress: Callable[[int, int], None] | None = None,
) -> Grown | None:
    """`grow_tracks` on the registered images; the result is numbered as the series."""
    # by themselves, so that they can be sent to other processes without the guide
    images, read_image, read_mask = value.images, guide.read_image, guide.read_mask
    grown = grow_tracks(
        value.cameras,
        take_subset(observations, images=images, min_length=2).observations,
        lambda i: read_image(int(images[i])),
        guide.options,
        extend=extend,
        read_mask=lambda i: read_mask(int(images[i])),
        read_keypoints=lambda i: guide.read_keypoints(int(images[i])),
        read_filtered=lambda i, high_pass_px: filtered(int(images[i]), high_pass_px),
        seed=seed,
        progress=progress,
        parallel_map=guide.parallel_map,
    )
    if grown is None:
        return None
    obs = grown.observations
    return replace(
        grown,
        observations=replace(
            obs, image_idx=images[obs.image_idx], num_images=observations.num_images
        ),
    )


def with_own_sigma(grown: Grown, value: Refined) -> Observations:
    """The observations with their relative standard deviations, learnt from the inliers."""
    obs = grown.observations
    length = np.bincount(obs.track_idx[value.inlier], minlength=obs.num_tracks)
    share = expected_share(
        length[obs.track_idx[value.inlier]], len(value.images), int(value.inlier.sum())
    )
    relative = fit_relative_sigma(
        np.asarray(value.adjustment.residuals),
        share,
        grown.sigma_px[value.inlier],
        grown.baseline_sine[value.inlier],
    )
    full = np.ones(len(obs))
    full[value.inlier] = relative
    return replace(obs, relative_sigma=full)
