"""A refined part becomes a reconstruction: error bars, hand, world."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from semsfm_colmap.geometry.rotations import MIRROR_Z, depth_reversed
from semsfm_colmap.mapping.tilt import known_tilts
from semsfm_colmap.motion.prior import TiltPrior
from semsfm_colmap.refinement.depth_reversal import (
    Cue,
    apply_user_word,
    axis_from_receding_edge,
    decide_depth_sign,
    known_tilt_cue,
    reverse_depth,
    visibility_cues,
)
from semsfm_colmap.refinement.displaced import Displacement
from semsfm_colmap.refinement.options import RefinementOptions
from semsfm_colmap.refinement.refine import Refined
from semsfm_colmap.refinement.trust import reliability, uncertainty_of
from semsfm_colmap.types import Float, Int, Observations, OrthographicCameras, Reconstruction

GAUGE = (
    "the world's axes are those of the first registered image (x right, y down, z away from the "
    "viewer), its origin is the centroid of the points; standard deviations are in the gauge of "
    "smallest total variance (inner constraints)"
)
RELIABILITY = (
    "total_rotation_deg",
    "total_rotation_sigma_deg",
    "total_rotation_sigma_parts_deg",
    "relief_px",
    "depth_uncertainty",
    "best_model",
    "models",
    "leave_one_out",
    "half_series",
    "scan_drift",
    "drift_px",
    "drag",
)
"""Diagnostics that say how far to trust a model. `drift_px`: what was taken out of the observations
of each image, displacement in x and y of the last row against the first; `drag`: what was taken
out by the shading's coefficient (`refinement.drag`)."""


NOTED_DRAG_PX = 0.1
"""A drag below this is not worth a sentence."""


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
    displacement: Displacement,
) -> MappedPart:
    """Error bars, hand, gauge and world unit of a refined part.

    The hand is judged on the `first` model: what its tracks see is what matching found by itself,
    a guided pass sees what the model says should be seen.

    Parameters
    ----------
    displacement : what was taken out of the observations

    """
    sizes = image_size_px[refined.images]
    uncertainty = uncertainty_of(refined, sizes[:, 1].astype(float), displacement)
    figures, notes, uncertainty = reliability(
        refined,
        uncertainty,
        options,
        sizes[:, 1].astype(float),
        displacement,
        tilt_known=tilt is not None,
    )
    covariance = None if uncertainty is None else uncertainty.total
    if "leave_one_out" in figures:
        numbers = figures["leave_one_out"]["images"]
        figures["leave_one_out"]["images"] = [image_names[refined.images[k]] for k in numbers]
    cues = find_cues(refined, first, image_names, image_size_px, options, tilt)
    sign, reverse = decide_depth_sign(cues, options.min_depth_sign_confidence)
    sign, reverse = apply_user_word(sign, reverse, options.depth_sign)
    cameras, points, point_covariance = in_world(
        refined.cameras,
        refined.points,
        None if covariance is None else covariance.points,
        pixel_size_um or 1.0,
    )
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
    drag = displacement.drag_figures(reverse=reverse)
    if displacement.drag_prior_px > 0.0:
        figures["drag"] = drag
        notes = [*notes, *drag_notes(drag)]
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


def drag_notes(drag: dict[str, float]) -> list[str]:
    """What to say of the drag taken out of a part."""
    c, sigma = drag["coefficient_px"], drag["sigma_px"]
    if abs(c) < max(NOTED_DRAG_PX, 2.0 * sigma):
        return []
    return [
        f"shading drags features {'down' if c > 0 else 'up'} the slopes of the specimen, by up to "
        f"{0.5 * abs(c):.2f} px (coefficient {c:.2f} +- {sigma:.2f} px); the observations are "
        "given as they would be without (drag)"
    ]


def find_cues(
    refined: Refined,
    first: Refined,
    image_names: tuple[str, ...],
    image_size_px: Int,
    options: RefinementOptions,
    tilt: TiltPrior | None,
) -> dict[str, Cue]:
    """All evidence of the hand: what the tracks see, and the direction of a known tilt."""
    cues = visibility_cues(
        first.cameras, first.points, first.observations, image_size_px[first.images]
    )
    if tilt is not None and options.receding_edge != "unknown":
        known, sigma = known_tilts(tilt, [image_names[i] for i in refined.images])
        cues["known tilt"] = known_tilt_cue(
            refined.cameras,
            known,
            axis_from_receding_edge(options.receding_edge),
            float(np.nanmedian(sigma)),
        )
    return cues


def in_world(
    cameras: OrthographicCameras, points: Float, covariance: Float | None, unit_per_px: float
) -> tuple[OrthographicCameras, Float, Float | None]:
    """Cameras, points (N, 3) and their covariances in the world that is written.

    Its origin is the centroid, its axes those of the first image, and the mean magnification shows
    a unit as ``1 / unit_per_px``.
    """
    centre = points.mean(axis=0)
    factor = float(np.exp(np.mean(np.log(cameras.scale_px_per_unit)))) * unit_per_px
    R0 = np.asarray(cameras.cam_from_world[0])
    moved = replace(
        cameras,
        translation_px=cameras.translation_px + cameras.projection @ centre,
        scale_px_per_unit=cameras.scale_px_per_unit / factor,
        cam_from_world=cameras.cam_from_world @ R0.T,
    )
    turned = None if covariance is None else factor**2 * (R0 @ covariance @ R0.T)
    return moved, (points - centre) @ R0.T * factor, turned


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
