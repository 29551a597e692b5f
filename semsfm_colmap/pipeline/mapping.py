"""From observations to reconstructions: factorization, refinement, hand, error bars, world units.

Pure: nothing is read or written here. A series that falls into parts gives one result a part.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from semsfm_colmap.factorization.degeneracy import RankDiagnosis, diagnose_rank
from semsfm_colmap.factorization.factorize import factorize_most, find_parts
from semsfm_colmap.factorization.options import FactorizationOptions
from semsfm_colmap.geometry.rotations import (
    MIRROR_Z,
    depth_reversed,
    rotation_angle,
)
from semsfm_colmap.ingest.tilt import TiltPrior, check_tilt, combine_tilt
from semsfm_colmap.pipeline.guided import Guide, refine_guided
from semsfm_colmap.pipeline.reliability import (
    SMALL_ROTATION_DEG,
    covariance_of,
    reliability,
    total_rotation_sigma,
)
from semsfm_colmap.refinement.depth_reversal import (
    apply_user_word,
    axis_from_receding_edge,
    decide_depth_sign,
    known_tilt_cue,
    reverse_depth,
    visibility_cues,
)
from semsfm_colmap.refinement.known_angles import angle_prior
from semsfm_colmap.refinement.model_choice import (
    total_rotation,
)
from semsfm_colmap.refinement.options import RefinementOptions
from semsfm_colmap.refinement.refine import Refined, adjust_with_angles, refine
from semsfm_colmap.tracks.diagnosis import diagnose_tracks
from semsfm_colmap.tracks.split import split_tracks
from semsfm_colmap.types import Float, Int, Observations, Reconstruction, Solution

GAUGE = (
    "the world's axes are those of the first registered image (x right, y down, z away from the "
    "viewer), its origin is the centroid of the points; standard deviations are in the gauge of "
    "smallest total variance (inner constraints)"
)
TIGHT = 0.1
"""Standard deviation of angles that are to hold, in formal errors of the images."""
RELIABILITY = (
    "total_rotation_deg",
    "total_rotation_sigma_deg",
    "depth_uncertainty",
    "best_model",
    "models",
    "leave_one_out",
    "scan_drift",
    "drift_px",
)
"""Diagnostics that say how far to trust a model. `drift_px`: what was taken out of the observations
of each image, displacement in x and y of the last row against the first."""
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


@dataclass(frozen=True, kw_only=True, eq=False)
class MappedPart:
    """One connected part of the series."""

    reconstruction: Reconstruction
    twin: Reconstruction | None
    """the depth-reversed model, where the evidence does not decide"""
    rounds: tuple[dict[str, Any], ...]
    diagnostics: dict[str, Any]
    guided: bool = False
    """True when the observations are those of the guided pass, not the database's keypoints"""

    @property
    def reliability(self) -> dict[str, Any]:
        """How far to trust the model as a whole, for orthographic.json and metrics.json."""
        return {key: self.diagnostics[key] for key in RELIABILITY if key in self.diagnostics}


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
        value, figures, drift_sigma, drift_said = first, {}, 0.0, []
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
                drift = second.drift_px[value.images].tolist()
                names = [image_names[i] for i in value.images]
                figures = {
                    "guided": second.figures,
                    "drift_px": dict(zip(names, drift, strict=True)),
                }
                drift_sigma = refinement.drift_sigma_px
                drift_said = drift_notes(second.drift_px)
        value, tilt_figures, tilt_notes = with_known_tilt(
            value, image_names, refinement, tilt, height_px, drift_sigma
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
                drift_sigma,
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


def finish(
    refined: Refined,
    observations: Observations,
    image_names: tuple[str, ...],
    image_size_px: Int,
    options: RefinementOptions,
    pixel_size_um: float | None,
    pixel_size_source: str,
    diagnostics: dict[str, Any],
    tilt_notes: list[str],
    tilt: TiltPrior | None,
    first: Refined,
    drift_sigma_px: float,
) -> MappedPart:
    """Error bars, hand, gauge and world unit of a refined part.

    The hand is judged on the `first` model: what its tracks see is what matching found by itself,
    a guided pass sees what the model says should be seen.

    Parameters
    ----------
    drift_sigma_px : prior of the scan drift where it was taken out of the observations, else 0

    """
    sizes = image_size_px[refined.images]
    covariance = covariance_of(refined, sizes[:, 1].astype(float), drift_sigma_px)
    cameras, points = refined.cameras, refined.points
    figures, notes = reliability(
        refined, covariance, options, sizes[:, 1].astype(float), tilt_known=tilt is not None
    )
    if "leave_one_out" in figures:
        numbers = figures["leave_one_out"]["images"]
        figures["leave_one_out"]["images"] = [image_names[refined.images[k]] for k in numbers]
    cues = visibility_cues(
        first.cameras, first.points, first.observations, image_size_px[first.images]
    )
    if tilt is not None and options.receding_edge != "unknown":
        known, sigma = known_tilts(tilt, [image_names[i] for i in refined.images])
        cues["known tilt"] = known_tilt_cue(
            cameras,
            known,
            axis_from_receding_edge(options.receding_edge),
            float(np.nanmedian(sigma)),
        )
    sign, reverse = decide_depth_sign(cues, options.min_depth_sign_confidence)
    sign, reverse = apply_user_word(sign, reverse, options.depth_sign)
    # gauge: origin at the centroid, axes of the first image, mean magnification 1 / pixel size
    unit = pixel_size_um or 1.0
    centre = points.mean(axis=0)
    magnification = float(np.exp(np.mean(np.log(cameras.scale_px_per_unit))))
    R0 = np.asarray(cameras.cam_from_world[0])
    factor = magnification * unit
    cameras = replace(
        cameras,
        translation_px=cameras.translation_px + cameras.projection @ centre,
        scale_px_per_unit=cameras.scale_px_per_unit / factor,
        cam_from_world=cameras.cam_from_world @ R0.T,
    )
    points = (points - centre) @ R0.T * factor
    point_covariance = None
    if covariance is not None:
        point_covariance = factor**2 * (R0 @ covariance.points @ R0.T)
    # all observations of the tracks that have a point, in registered images; rejected ones marked
    image_number = np.full(observations.num_images, -1, dtype=np.int64)
    image_number[refined.images] = np.arange(len(refined.images))
    track_number = np.full(observations.num_tracks, -1, dtype=np.int64)
    track_number[refined.tracks] = np.arange(len(refined.tracks))
    kept = (image_number[observations.image_idx] >= 0) & (track_number[observations.track_idx] >= 0)
    selected = observations.select(kept)
    reconstruction = Reconstruction(
        image_names=tuple(image_names[i] for i in refined.images),
        image_size_px=sizes,
        cameras=cameras,
        points=points,
        observations=replace(
            selected,
            image_idx=image_number[selected.image_idx],
            track_idx=track_number[selected.track_idx],
            num_images=len(refined.images),
            num_tracks=len(refined.tracks),
        ),
        inlier=refined.inlier[kept],
        point_covariance=point_covariance,
        sigma_rotation_rad=None if covariance is None else covariance.sigma_rotation_rad,
        sigma_translation_px=None if covariance is None else covariance.sigma_translation_px,
        sigma_scale=None if covariance is None else covariance.sigma_scale,
        world_unit="px" if pixel_size_um is None else "um",
        pixel_size_um=pixel_size_um,
        pixel_size_source=pixel_size_source,
        camera_model=options.camera_model,
        depth_sign=sign,
        gauge=GAUGE,
    )
    if reverse:
        reconstruction = reversed_twin(reconstruction)
    twin = reversed_twin(reconstruction) if sign.status == "ambiguous" else None
    return MappedPart(
        reconstruction=reconstruction,
        twin=twin,
        rounds=tuple(asdict(r) for r in first.rounds),
        guided="guided" in diagnostics,
        diagnostics={
            **diagnostics,
            **figures,
            "notes": [*tilt_notes, *notes],
            "sigma_px": refined.sigma_px,
            "depth_sign_cues": {
                name: {"t": -c.t if reverse else c.t, "num_regions": c.num_regions}
                for name, c in cues.items()
            },
        },
    )


def known_tilts(tilt: TiltPrior, names: list[str]) -> tuple[Float, Float]:
    """Known angles and their sigmas of some images, nan where nothing is known."""
    number = {name: k for k, name in enumerate(tilt.image_names)}
    rows = np.array([number[name] for name in names])
    return tilt.angle_rad[rows], tilt.sigma_rad[rows]


def with_known_tilt(
    refined: Refined,
    image_names: tuple[str, ...],
    options: RefinementOptions,
    tilt: TiltPrior | None,
    height_px: Float,
    drift_sigma_px: float,
) -> tuple[Refined, dict[str, Any], list[str]]:
    """Adjust with the known tilt when the images agree with it; else say so and leave it out.

    The adjusted angles are those of the images, all stretched by one factor (`combine_tilt`): how
    they lie to one another the images know better than any stage. The error bars stay those of the
    images alone.
    """
    if tilt is None:
        return refined, {}, []
    names = [image_names[i] for i in refined.images]
    R = np.asarray(refined.cameras.cam_from_world)
    check = check_tilt(tilt, names, R)
    figures = {
        "source": tilt.source,
        "consistent": check.consistent,
        "factor": None if np.isnan(check.factor) else check.factor,
        "tolerance": None if np.isnan(check.tolerance) else check.tolerance,
    }
    known = angle_prior(*known_tilts(tilt, names))
    covariance = covariance_of(refined, height_px[refined.images], drift_sigma_px)
    if not check.consistent or known is None or covariance is None or np.isnan(check.factor):
        return refined, {"tilt_prior": figures}, [check.message]
    combined = combine_tilt(check, total_rotation(R), total_rotation_sigma(refined, covariance))
    # the adjustment knows of no drift: what holds against it is measured by its own error bars
    own = covariance
    if drift_sigma_px > 0.0:
        own = covariance_of(refined, height_px[refined.images], 0.0) or covariance
    a, b = known.pairs.T
    angles = replace(
        known,
        angle_rad=combined.stretch * rotation_angle(R[a] @ R[b].transpose(0, 2, 1)),
        sigma_rad=np.full(len(a), TIGHT * total_rotation_sigma(refined, own)),
    )
    adjusted = replace(
        adjust_with_angles(refined, angles, options), state=refined.state, model=refined.model
    )
    figures |= {"stretch": combined.stretch, "weight": combined.weight, "sigma": combined.sigma}
    note = (
        f"{check.message}; with a weight of {100 * combined.weight:.0f} % for the known tilts "
        f"({tilt.source}) the angles changed by {100 * (combined.stretch - 1):+.2f} %"
    )
    return adjusted, {"tilt_prior": figures}, [note]


def reversed_twin(reconstruction: Reconstruction) -> Reconstruction:
    """The depth-reversed model: same images, other hand."""
    cameras, points = reverse_depth(reconstruction.cameras, np.asarray(reconstruction.points))
    covariance = reconstruction.point_covariance
    return replace(
        reconstruction,
        cameras=replace(
            cameras,
            cam_from_world=depth_reversed(np.asarray(reconstruction.cameras.cam_from_world)),
        ),
        points=points,
        point_covariance=None if covariance is None else MIRROR_Z @ covariance @ MIRROR_Z,
    )
