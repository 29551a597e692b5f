"""From observations to reconstructions: factorization, refinement, hand, error bars, world units.

Pure: nothing is read or written here. A series that falls into parts gives one result a part.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict

import numpy as np

from semsfm_colmap.factorization.degeneracy import RankDiagnosis, diagnose_rank
from semsfm_colmap.factorization.factorize import factorize_most, find_parts
from semsfm_colmap.factorization.options import FactorizationOptions
from semsfm_colmap.mapping.finish import MappedPart, finish
from semsfm_colmap.mapping.guided import Guide, refine_guided
from semsfm_colmap.mapping.tilt import known_tilts, with_known_tilt
from semsfm_colmap.motion.prior import TiltPrior
from semsfm_colmap.refinement.displaced import Displacement
from semsfm_colmap.refinement.options import RefinementOptions
from semsfm_colmap.refinement.refine import refine
from semsfm_colmap.refinement.trust import SMALL_ROTATION_DEG
from semsfm_colmap.tracks.diagnosis import diagnose_tracks
from semsfm_colmap.tracks.split import split_tracks
from semsfm_colmap.types import Float, Int, Observations, Solution

NOTED_DRIFT_PX = 0.1
"""Scan drift below this is not worth a sentence."""
WEAK_GAP = 1.5
"""Fourth over third eigenvalue of the camera basis constraints: 1.05 for a chain whose slow bending
noise hides, above 2 for all series that came out right."""
WEAK_NOTE = (
    "the tracks tie the series together weakly: over the whole of it the angles may have drifted "
    "off though neighbours fit; match images further apart, so that tracks last longer"
)
EQUAL_TILTS_DEG = 0.1
"""Recorded tilts that differ by less are equal: stages are read to 0.1 deg at best."""


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
    seed: int = 0,
    note: Callable[[str], None] | None = None,
) -> Solution[list[MappedPart]]:
    """Reconstruct every connected part of a series, the one with the most images first.

    Parameters
    ----------
    observations : sorted by track; images numbered as `image_names`
    tilt : known angles; used as a prior where the images do not contradict them
    guide : the images, for a second pass that looks for every point in every image
    note : called with a sentence after each step

    Returns
    -------
    Solution of the parts; without any, the status and message of the largest one's failure

    """
    say = note or (lambda sentence: None)
    rng = np.random.default_rng(seed)
    height_px = image_size_px[:, 1].astype(float)
    parts = find_parts(observations, factorization)
    tracks = diagnose_tracks(observations)
    if not parts:
        status, message = tracks.failure(factorization.min_block_tracks)
        return Solution(value=None, status=status, message=message)
    mapped: list[MappedPart] = []
    failure: Solution[list[MappedPart]] | None = None
    for part in parts:
        rank = diagnose_rank(part.blocks)
        if rank.status != "ok":
            status, message = without_depth(rank, tilt, [image_names[i] for i in part.images])
            failure = failure or Solution(
                value=None, status=status, message=message, diagnostics=asdict(rank)
            )
            continue
        tied, start = factorize_most(part, observations, factorization, rng)
        if start.value is None:
            failure = failure or Solution(
                value=None,
                status=start.status,
                message=start.message,
                diagnostics=start.diagnostics,
            )
            continue
        say(
            f"factorization: {len(tied.images)} images, {len(tied.blocks)} complete blocks, "
            f"affine residual {start.diagnostics['affine_rms_px']:.3f} px"
        )
        cameras, _ = start.value
        seen = split_tracks(
            observations,
            cameras,
            tied.images,
            min_length=refinement.min_track_length,
            trials=refinement.ransac_trials,
            seed=seed,
        )
        refined = refine(
            cameras,
            tied.images,
            seen,
            refinement,
            rng=rng,
            seed=seed,
            progress=lambda r: say(
                f"within {r.threshold_px:.2f} px: {r.num_images} images, {r.num_points} points, "
                f"{r.num_observations} observations, sigma {r.sigma_px:.3f} px"
            ),
        )
        if refined.value is None:
            failure = failure or Solution(
                value=None, status=refined.status, message=refined.message
            )
            continue
        first, used = refined.value, seen
        value, figures, drift_said = first, {}, []
        displacement = Displacement.none(len(first.images))
        if guide is not None and guide.options.enabled:
            second = refine_guided(
                first,
                seen,
                guide,
                refinement,
                height_px,
                rng=rng,
                seed=seed,
                say=say,
            )
            if second is None:
                say("guided pass: it finds less than is known already, and was left out")
            else:
                value, used = second.refined, second.observations
                displacement = second.displacement
                names = [image_names[i] for i in value.images]
                figures = {
                    "guided": second.figures,
                    "drift_px": dict(zip(names, displacement.drift_px.tolist(), strict=True)),
                }
                drift_said = drift_notes(displacement.drift_px)
        value, tilt_figures, tilt_notes = with_known_tilt(
            value, image_names, refinement, tilt, height_px, displacement
        )
        if start.diagnostics.get("eigenvalue_gap", np.inf) < WEAK_GAP:
            tilt_notes = [WEAK_NOTE, *tilt_notes]
        mapped.append(
            finish(
                value,
                used,
                image_names,
                image_size_px,
                refinement,
                pixel_size_um,
                pixel_size_source,
                {**start.diagnostics, **figures, **tilt_figures},
                [*tilt_notes, *drift_said],
                tilt,
                first,
                displacement,
            )
        )
        say(mapped[-1].reconstruction.depth_sign.message)
    if not mapped:
        assert failure is not None
        return failure
    mapped.sort(key=lambda p: -p.reconstruction.num_images)
    notes = tracks.notes(image_names)
    mapped[0].diagnostics["notes"].extend(notes.values())
    if mapped[0].diagnostics["total_rotation_deg"] < SMALL_ROTATION_DEG:
        notes["small_rotation"] = ""
    if len(mapped) > 1:
        notes["several_parts"] = ""
    # "ok", or what is to be said of the series, its sentences among the notes
    return Solution(value=mapped, status=", ".join(notes) or "ok")


def drift_notes(drift_px: Float) -> list[str]:
    """What to say of the scan drift taken out of a part."""
    largest = float(np.abs(drift_px).max(initial=0.0))
    if largest < NOTED_DRIFT_PX:
        return []
    return [
        "the specimen drifted while the frames were scanned, the last row against the first by up "
        f"to {largest:.2f} px; the observations are given as they would be without (drift_px)"
    ]


def without_depth(rank: RankDiagnosis, tilt: TiltPrior | None, names: list[str]) -> tuple[str, str]:
    """Status and sentence of a part whose images show no depth; recorded tilts may say why."""
    if tilt is not None and rank.status == "pure_translation":
        known = np.rad2deg(known_tilts(tilt, names)[0])
        known = known[np.isfinite(known)]
        span = float(np.ptp(known)) if len(known) > 1 else np.nan
        if span < EQUAL_TILTS_DEG:
            return (
                "equal_tilts",
                "the images show no depth: they were all recorded at the same tilt of "
                f"{np.mean(known):.1f} deg ({tilt.source}); tilt the specimen between the images",
            )
        if span < SMALL_ROTATION_DEG:
            return (
                "tilt_too_small",
                f"the images show no depth: the recorded tilts ({tilt.source}) span {span:.1f} deg "
                "only, and what they would show is hidden in the noise; tilt further",
            )
    return rank.status, rank.message
