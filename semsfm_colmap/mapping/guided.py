"""The guided second pass: every point is looked for in every image, until the cameras settle.

What is not found again where it was seen is not looked for in all other images. Cameras that turn
settle on a sample of the tracks, where images have many, before all tracks are looked for.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from semsfm_colmap.geometry.alignment import align_rotations
from semsfm_colmap.geometry.rotations import rotation_angle
from semsfm_colmap.geometry.subset import keep_tracks, take_subset, thin_evenly
from semsfm_colmap.mapping.context import Guide, SeriesContext
from semsfm_colmap.mapping.drift import adjust_last
from semsfm_colmap.matching.guided.filtering import FilteredImages
from semsfm_colmap.matching.guided.grow import HIGH_PASS_PX, Grown, grow_tracks
from semsfm_colmap.matching.guided.noise import fit_relative_sigma
from semsfm_colmap.matching.guided.options import GuidedOptions
from semsfm_colmap.records import GuidedFigures
from semsfm_colmap.refinement.displaced import Displacement
from semsfm_colmap.refinement.noise import expected_share
from semsfm_colmap.refinement.options import RefinementOptions
from semsfm_colmap.refinement.refine import Refined, refine
from semsfm_colmap.types import Observations

SETTLING_OBSERVATIONS = 800
"""Observations of an image that the cameras settle on; all, where it has fewer."""
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
    turned_deg: float
    """root mean square angle by which the last pass turned the cameras"""


@dataclass(frozen=True, kw_only=True, eq=False)
class Passes:
    """What all passes over a part have in common."""

    context: SeriesContext
    guide: Guide
    options: GuidedOptions
    refinement: RefinementOptions
    """without the thresholds within which every place that a pass looks at lies"""
    filtered: FilteredImages
    num_images: int
    """a pass that registers fewer is none"""
    rng: np.random.Generator
    of: str = ""
    """which points are looked for, for the sentences about it"""

    def with_options(self, **changes: Any) -> Passes:
        """With other options."""
        return replace(self, options=replace(self.options, **changes))

    def as_fine_as(self, found: Settling) -> Passes:
        """With the high-pass of a pass before, where there is no finer one to try."""
        high_pass_px = found.grown.high_pass_px
        return (
            self.with_options(high_pass_px=high_pass_px)
            if high_pass_px == HIGH_PASS_PX[0]
            else self
        )


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
    options = guide.options
    within = tuple(t for t in context.refinement.filter_thresholds_px if t <= options.max_shift_px)
    passes = Passes(
        context=context,
        guide=guide,
        options=options,
        refinement=replace(
            context.refinement,
            filter_thresholds_px=within or context.refinement.filter_thresholds_px[-1:],
        ),
        filtered=FilteredImages(guide.read_image),
        num_images=len(first.images),
        rng=rng,
    )
    # a pair that is found again is as good a start as any
    pairs_too = passes.with_options(min_track_length=2)
    aligned = one_pass(pairs_too, first, observations, extend=False, done=0)
    if aligned is None or options.rounds == 1:
        return aligned
    passes, seeds = passes.as_fine_as(aligned), aligned.grown.observations
    chosen = thin_evenly(seeds, SETTLING_OBSERVATIONS)
    thin = seeds.num_tracks < options.fill_up_to or chosen.all()
    if thin or aligned.turned_deg < options.converged_deg:
        return repeat(passes, aligned, seeds, options.rounds)
    sample, _ = keep_tracks(seeds, chosen[seeds.track_idx])
    few = replace(passes.with_options(fill_up_to=0), of="a sample of ")
    settled = repeat(few, aligned, sample, options.rounds - 1) or aligned
    return one_pass(passes, settled.refined, seeds, extend=True, done=settled.num_passes)


def repeat(passes: Passes, start: Settling, seeds: Observations, most: int) -> Settling | None:
    """Look everywhere until the cameras no longer turn, or so many passes have been made."""
    settled = start
    while settled.num_passes < most:
        before, done = settled.refined, settled.num_passes
        found = one_pass(passes, before, seeds, extend=True, done=done)
        if found is None:
            return None
        settled, seeds = found, found.grown.observations
        growth = len(settled.refined.observations) / max(len(before.observations), 1)
        if settled.turned_deg < passes.options.converged_deg and growth < SETTLED_GROWTH:
            break
    return settled


def one_pass(
    passes: Passes, value: Refined, seeds: Observations, *, extend: bool, done: int
) -> Settling | None:
    """Look for points with a model, and adjust it to what is found, after so many other passes."""
    context = passes.context
    step = grow_part(passes, value, seeds, extend=extend, done=done)
    if step is None:
        return None
    adjusted = refine(
        value.cameras,
        value.images,
        step.observations,
        passes.refinement,
        rng=passes.rng,
        seed=context.seed,
        series_idx=context.series_idx,
    ).value
    if adjusted is None or len(adjusted.images) < passes.num_images:
        return None
    turned_deg = float(np.rad2deg(camera_turn(value, adjusted)))
    context.say(
        f"guided pass {done + 1}: structure finer than {step.high_pass_px:g} px, "
        f"{len(step.observations)} of {step.num_predicted} places found, "
        f"{passes.of}{len(adjusted.tracks)} points, {len(adjusted.observations)} observations, "
        f"sigma {adjusted.sigma_px:.3f} px, cameras turned by {turned_deg:.3f} deg"
    )
    return Settling(refined=adjusted, grown=step, num_passes=done + 1, turned_deg=turned_deg)


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
    passes: Passes,
    value: Refined,
    observations: Observations,
    *,
    extend: bool,
    done: int,
) -> Grown | None:
    """`grow_tracks` on the registered images; the result is numbered as the series."""
    guide, rounds = passes.guide, passes.options.rounds

    def looked(images: int, total: int) -> None:
        passes.context.progress("guided passes", done * total + images, rounds * total)

    # by themselves, so that they can be sent to other processes without the guide and the context
    images, read_image, read_mask = value.images, guide.read_image, guide.read_mask
    filtered = passes.filtered
    grown = grow_tracks(
        value.cameras,
        take_subset(observations, images=images, min_length=2).observations,
        lambda i: read_image(int(images[i])),
        passes.options,
        extend=extend,
        read_mask=lambda i: read_mask(int(images[i])),
        read_keypoints=lambda i: guide.read_keypoints(int(images[i])),
        read_filtered=lambda i, high_pass_px: filtered(int(images[i]), high_pass_px),
        seed=passes.context.seed,
        progress=looked,
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
