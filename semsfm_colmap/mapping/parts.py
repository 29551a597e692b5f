"""From observations to reconstructions: factorization, refinement, hand, error bars, world units.

Pure: nothing is read or written here. A series that falls into parts gives one result a part.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from itertools import count

import numpy as np

from semsfm_colmap.factorization.blocks import Part
from semsfm_colmap.factorization.degeneracy import diagnose_rank
from semsfm_colmap.factorization.factorize import Factorized, factorize_most, find_parts
from semsfm_colmap.factorization.options import FactorizationOptions
from semsfm_colmap.geometry.threads import blas_threads
from semsfm_colmap.mapping.context import Guide, SeriesContext, silent
from semsfm_colmap.mapping.drift import drift_notes
from semsfm_colmap.mapping.finish import MappedPart, Settled, finish, rests_on
from semsfm_colmap.mapping.flat import find_flat, flat_note, settle_flat
from semsfm_colmap.mapping.guided import Guided, refine_guided
from semsfm_colmap.mapping.no_depth import without_depth
from semsfm_colmap.mapping.perspective import Straight, judge_perspective, straighten
from semsfm_colmap.mapping.tilt import displacement_notes, with_known_tilt
from semsfm_colmap.motion.prior import TiltPrior
from semsfm_colmap.motion.small_tilt import SMALL_ROTATION_DEG
from semsfm_colmap.records import FilteringRound
from semsfm_colmap.refinement.displaced import Displacement
from semsfm_colmap.refinement.magnification import magnification_notes, magnification_sigma
from semsfm_colmap.refinement.options import RefinementOptions
from semsfm_colmap.refinement.refine import Refined, refine
from semsfm_colmap.refinement.trust import compare
from semsfm_colmap.tracks.diagnosis import diagnose_tracks
from semsfm_colmap.tracks.split import split_tracks
from semsfm_colmap.types import Int, Observations, Solution

WEAK_GAP = 1.5
"""Fourth over third eigenvalue of the camera basis constraints: 1.05 for a chain whose slow bending
noise hides, above 2 for all series that came out right."""
WEAK_NOTE = (
    "the tracks tie the series together weakly: over the whole of it the angles may have drifted "
    "off though neighbours fit; match images further apart, so that tracks last longer"
)
NUM_ROUNDS_SHOWN = 8
"""Rounds of filtering that the progress takes for the first model: seldom more."""
MAGNIFICATION_ROUNDS = 2
"""The first estimate of its width has the noise of too narrow a prior."""
REPEATABLE_IMAGES = 60
"""Up to so many one thread of linear algebra is the fastest, and gives the same on any machine."""
MIN_PLANE_STRETCH = 1.01
"""Foreshortening between images that a tilt of 8 degrees explains, and the fraction of a degree of
a model that lost its depth does not."""


def map_observations(
    observations: Observations,
    image_names: tuple[str, ...],
    image_size_px: Int,
    *,
    factorization: FactorizationOptions,
    refinement: RefinementOptions,
    pixel_size_um: float | None = None,
    pixel_size_source: str = "none",
    tilt: TiltPrior | None = None,
    guide: Guide | None = None,
    series_idx: Int | None = None,
    seed: int = 0,
    note: Callable[[str], None] | None = None,
) -> Solution[list[MappedPart]]:
    """Reconstruct every connected part of a series, the one with the most images first.

    Parameters
    ----------
    observations : sorted by track; images numbered as `image_names`
    image_names : of the M images, in the order of acquisition
    image_size_px : (M, 2) width, height
    factorization, refinement : options of these stages
    pixel_size_um, pixel_size_source : the size of a pixel and where it was read; without one the
        world is in px
    tilt : known angles; used as a prior where the images do not contradict them
    guide : the images, for a second pass that looks for every point in every image
    series_idx : (M,) which of several series each image is from
    seed : same seed, same result
    note : called with a sentence after each step

    Returns
    -------
    Solution of the parts; without any, the status and message of the largest one's failure

    """
    context = SeriesContext(
        image_names=image_names,
        image_size_px=image_size_px,
        factorization=factorization,
        refinement=refinement,
        pixel_size_um=pixel_size_um,
        pixel_size_source=pixel_size_source,
        tilt=tilt,
        guide=guide,
        series_idx=series_idx,
        seed=seed,
        say=note or silent,
    )
    return map_parts(context, observations)


def map_parts(context: SeriesContext, observations: Observations) -> Solution[list[MappedPart]]:
    """`map_observations` of a series with its context."""
    with blas_threads(1 if len(context.image_names) <= REPEATABLE_IMAGES else None):
        return _map_parts(context, observations)


def _map_parts(context: SeriesContext, observations: Observations) -> Solution[list[MappedPart]]:
    rng = np.random.default_rng(context.seed)
    parts = find_parts(observations, context.factorization)
    tracks = diagnose_tracks(observations)
    if not parts:
        status, message = tracks.failure(context.factorization.min_block_tracks)
        return Solution(value=None, status=status, message=message)
    found = [map_part(context, part, observations, rng) for part in parts]
    mapped = sorted(
        (solution.value for solution in found if solution.value is not None),
        key=lambda part: -part.reconstruction.num_images,
    )
    if not mapped:
        first = found[0]
        return Solution(
            value=None,
            status=first.status,
            message=first.message,
            diagnostics=first.diagnostics,
        )
    notes = tracks.notes(context.image_names)
    mapped[0] = mapped[0].with_notes(notes.values())
    statuses = list(notes)
    if mapped[0].figures.reliability.total_rotation_deg < SMALL_ROTATION_DEG:
        statuses.append("small_rotation")
    if len(mapped) > 1:
        statuses.append("several_parts")
    # "ok", or what is to be said of the series, its sentences among the notes
    return Solution(value=mapped, status=", ".join(statuses) or "ok")


@dataclass(frozen=True, kw_only=True, eq=False)
class First:
    """The first model of a part: what the matches alone give."""

    start: Factorized
    observations: Observations
    """of the whole series, tracks of two points cut in two"""
    refined: Refined


def map_part(
    context: SeriesContext, part: Part, observations: Observations, rng: np.random.Generator
) -> Solution[MappedPart]:
    """One connected part: first model, guided pass, known tilt, hand and world."""
    begun = first_model(context, part, observations, rng)
    if begun.value is None:
        return Solution(
            value=None,
            status=begun.status,
            message=begun.message,
            diagnostics=begun.diagnostics,
        )
    asked, guided = context.refinement, None
    straight = straighten(context, begun.value.refined, begun.value.observations, rng=rng)
    if straight is not None:
        context = straight.context
        first = replace(begun.value, refined=straight.refined, observations=straight.observations)
    else:
        context, first = with_magnification(context, begun.value, rng)
        guided = guide_part(context, first, rng)
    settled = settle(context, first, guided, straight, asked)
    if settled.value is None:
        return Solution(value=None, status=settled.status, message=settled.message)
    context.progress("error bars and hand", 0, 1)
    mapped = finish(context, settled.value)
    rests = rests_on(context, mapped)
    if rests.is_noise:
        return Solution(value=None, status="noise", message=rests.message)
    context.say(mapped.reconstruction.depth_sign.message)
    return Solution(value=mapped)


def settle(
    context: SeriesContext,
    first: First,
    guided: Guided | None,
    straight: Straight | None,
    asked: RefinementOptions,
) -> Solution[Settled]:
    """The camera models compared, flatness, known tilts, and what is to be said of all that.

    Parameters
    ----------
    straight : perspective that was taken out
    asked : the options before anything was learnt from the series

    """
    value = first.refined if guided is None else guided.refined
    displacement = Displacement.none(len(value.images))
    if guided is not None:
        displacement = guided.displacement
    choice = None
    if straight is not None:
        displacement = replace(
            displacement, perspective=straight.figures, view=straight.perspective
        )
    else:
        choice = judge_perspective(context, value)
    sizes = context.image_size_px[value.images].astype(np.float64)
    further = () if choice is None or not choice.found else (choice.rung,)
    context.progress("camera models", 0, 1)
    comparison = compare(value, context.refinement, sizes[:, 1], sizes, further)
    flat = find_flat(first.refined, value)
    agreement = None
    if flat is not None:
        settled = settle_flat(context, value, flat)
        if settled.value is None:
            return Solution(value=None, status=settled.status, message=settled.message)
        value, notes = settled.value, [flat_note(context)]
        # what the images of a plane make of its angles has no say
        comparison = replace(comparison, rungs=comparison.rungs[:1], alive=())
    else:
        value, agreement, notes = with_known_tilt(context, value, displacement)
        notes = [*notes, *displacement_notes(context, value)]
    gap = first.start.figures.eigenvalue_gap
    if gap is not None and gap < WEAK_GAP:
        notes = [WEAK_NOTE, *notes]
    if guided is not None:
        notes = [*notes, *drift_notes(displacement.drift_px)]
    if straight is None:
        scale = np.asarray(value.cameras.scale_px_per_unit / value.cameras.common_scale)
        learnt = context.refinement.scale_sigma > asked.scale_sigma
        notes = [*notes, *magnification_notes(scale, sizes, estimated=learnt)]
    return Solution(
        value=Settled(
            refined=value,
            observations=first.observations if guided is None else guided.observations,
            first=first.refined,
            start=first.start.figures,
            guided=guided,
            tilt=agreement,
            displacement=displacement,
            comparison=comparison,
            perspective=choice,
            notes=tuple(notes),
        )
    )


def first_model(
    context: SeriesContext, part: Part, observations: Observations, rng: np.random.Generator
) -> Solution[First]:
    """Factorize a part and refine it, or say why it gives no model."""
    context.progress("first model", 0, 1)
    rank = diagnose_rank(part.blocks)
    if rank.status != "ok" and not (rank.status == "planar" and context.tilt is not None):
        status, message = without_depth(rank, context.tilt, list(context.names_of(part.images)))
        return Solution(value=None, status=status, message=message, diagnostics=asdict(rank))
    tied, start = factorize_most(part, observations, context.factorization, rng)
    if start.value is None:
        return Solution(
            value=None,
            status=start.status,
            message=start.message,
            diagnostics=start.diagnostics,
        )
    context.say(
        f"factorization: {len(tied.images)} images, {len(tied.blocks)} complete blocks, "
        f"affine residual {start.value.figures.affine_rms_px:.3f} px"
    )
    seen = split_tracks(
        observations,
        start.value.cameras,
        tied.images,
        min_length=context.refinement.min_track_length,
        trials=context.refinement.ransac_trials,
        seed=context.seed,
    )

    rounds = count(1)

    def tell(r: FilteringRound) -> None:
        context.progress("first model", next(rounds), NUM_ROUNDS_SHOWN)
        context.say(
            f"within {r.threshold_px:.2f} px: {r.num_images} images, {r.num_points} points, "
            f"{r.num_observations} observations, sigma {r.sigma_px:.3f} px"
        )

    refined = refine(
        start.value.cameras,
        tied.images,
        seen,
        context.refinement,
        rng=rng,
        seed=context.seed,
        series_idx=context.series_idx,
        progress=tell,
    )
    if refined.value is None:
        if refined.status == "tilt_too_small" and rank.stretch > MIN_PLANE_STRETCH:
            # the images are foreshortened: it is the specimen that has no depth
            flat = replace(rank, status="planar")
            return Solution(value=None, status="planar", message=flat.message)
        return Solution(value=None, status=refined.status, message=refined.message)
    return Solution(value=First(start=start.value, observations=seen, refined=refined.value))


def with_magnification(
    context: SeriesContext, first: First, rng: np.random.Generator
) -> tuple[SeriesContext, First]:
    """The prior of the magnification as wide as the series shows, and the first model with it."""
    for _ in range(MAGNIFICATION_ROUNDS):
        options = context.refinement
        width = magnification_sigma(first.refined, options)
        if width <= options.scale_sigma:
            break
        wider = replace(options, scale_sigma=width)
        value = first.refined
        again = refine(
            value.cameras,
            value.images,
            first.observations,
            wider,
            rng=rng,
            seed=context.seed,
            series_idx=context.series_idx,
        ).value
        if again is None or len(again.images) < len(value.images):
            break
        context.say(
            f"the magnification differs between the images by some {100 * width:g} %: sigma "
            f"{value.sigma_px:.3f} -> {again.sigma_px:.3f} px with a prior as wide"
        )
        context = replace(context, refinement=wider)
        first = replace(first, refined=again)
    return context, first


def guide_part(context: SeriesContext, first: First, rng: np.random.Generator) -> Guided | None:
    """The guided second pass, where the images are at hand and it finds more than is known."""
    if context.guide is None or not context.guide.options.enabled:
        return None
    guided = refine_guided(context, context.guide, first.refined, first.observations, rng=rng)
    if guided is None:
        context.say("guided pass: it finds less than is known already, and was left out")
    return guided
