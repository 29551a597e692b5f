"""A refined part becomes a reconstruction: error bars, hand, world."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from semsfm_colmap.geometry.perspective import Perspective
from semsfm_colmap.geometry.rotations import MIRROR_Z, depth_reversed
from semsfm_colmap.geometry.subset import take_exactly
from semsfm_colmap.mapping.context import SeriesContext
from semsfm_colmap.mapping.drift import drag_notes, has_drift
from semsfm_colmap.mapping.guided import Guided
from semsfm_colmap.mapping.merged import series_sigmas
from semsfm_colmap.mapping.perspective import perspective_notes
from semsfm_colmap.motion.prior import known_tilts
from semsfm_colmap.records import CueFigures, Diagnostics, PartFigures, StartFigures, TiltAgreement
from semsfm_colmap.refinement.covariance import Covariance
from semsfm_colmap.refinement.depth_reversal import (
    CUES,
    SHAPE_CUES,
    Cue,
    apply_user_word,
    axis_from_receding_edge,
    decide_depth_sign,
    known_tilt_cue,
    reverse_depth,
    visibility_cues,
)
from semsfm_colmap.refinement.displaced import Displacement
from semsfm_colmap.refinement.model_choice import DRIFT_RUNG, ModelComparison
from semsfm_colmap.refinement.perspective_choice import PerspectiveChoice
from semsfm_colmap.refinement.refine import Refined
from semsfm_colmap.refinement.substance import Substance, substance
from semsfm_colmap.refinement.trust import reliability, uncertainty_of
from semsfm_colmap.types import DepthSign, Float, Observations, OrthographicCameras, Reconstruction

GAUGE = (
    "the world's axes are those of the first registered image (x right, y down, z away from the "
    "viewer), its origin is the centroid of the points; standard deviations are in the gauge of "
    "smallest total variance (inner constraints)"
)


@dataclass(frozen=True, kw_only=True, eq=False)
class MappedPart:
    """One connected part of the series."""

    reconstruction: Reconstruction
    twin: Reconstruction | None
    """the depth-reversed model, where the evidence does not decide"""
    figures: PartFigures
    view: Perspective | None = None
    """perspective that was taken out of the observations, in the world of the reconstruction"""

    @property
    def moved(self) -> bool:
        """True when the observations lie beside the keypoints that they are."""
        perspective = self.figures.reliability.perspective
        return not self.guided and perspective is not None and perspective.used

    @property
    def guided(self) -> bool:
        """True when the observations are those of the guided pass, not the database's keypoints."""
        return self.figures.diagnostics.guided is not None

    def with_notes(self, notes: Iterable[str]) -> MappedPart:
        """The same part with more to be said of it."""
        return replace(self, figures=replace(self.figures, notes=(*self.figures.notes, *notes)))


@dataclass(frozen=True, kw_only=True, eq=False)
class Settled:
    """A part whose cameras and points are what they will be, but for hand and world."""

    refined: Refined
    observations: Observations
    """of the whole series"""
    first: Refined
    """the model before the guided pass"""
    start: StartFigures
    guided: Guided | None
    tilt: TiltAgreement | None
    displacement: Displacement
    """what was taken out of the observations"""
    comparison: ModelComparison
    """the ladder of camera models on the images alone"""
    perspective: PerspectiveChoice | None
    """perspective that was looked for and not taken out; None where it was taken out"""
    notes: tuple[str, ...]


def finish(context: SeriesContext, part: Settled) -> MappedPart:
    """Error bars, hand, gauge and world unit of a refined part.

    What hides what is judged on the first model: what its tracks see is what matching found by
    itself, a guided pass sees what the model says should be seen. The shape is that of the last.
    """
    refined = part.refined
    names = context.names_of(refined.images)
    height_px = context.height_px[refined.images]
    choice = part.perspective
    found = choice if choice is not None and choice.found else None
    uncertainty = uncertainty_of(
        refined,
        height_px,
        part.displacement,
        left_in=None if found is None else found.fit,
        comparison=part.comparison,
        camera_model=context.refinement.camera_model,
    )
    covariance = None if uncertainty is None else uncertainty.total
    trust, notes = reliability(
        refined,
        uncertainty,
        context.refinement,
        part.comparison,
        names,
        tilt_known=context.tilt is not None,
        drift_found=part.comparison.best == DRIFT_RUNG and has_drift(context, refined),
    )
    if choice is not None and found is None:
        # listed, but of no weight
        trust = replace(trust, models=(*trust.models, choice.rung))
    cues = find_cues(context, refined, part.first)
    sign, reverse = decide_depth_sign(cues, context.refinement.min_depth_sign_confidence)
    sign, reverse = apply_user_word(sign, reverse, context.refinement.depth_sign)
    reconstruction = to_world(context, part, covariance, sign)
    view = view_in_world(part, context.pixel_size_um or 1.0)
    if reverse:
        reconstruction = reversed_twin(reconstruction)
    displacement = part.displacement
    if found is not None:
        displacement = replace(displacement, perspective=found.figures(used=False))
    guided, drag = part.guided, displacement.drag_figures(reverse=reverse)
    perspective = displacement.perspective_figures(reverse=reverse)
    trust = replace(trust, perspective=perspective, series=series_sigmas(refined, uncertainty))
    if guided is not None:
        drift = displacement.drift_px.tolist()
        trust = replace(
            trust,
            drift_px={name: (a, b) for name, (a, b) in zip(names, drift, strict=True)},
            drag=drag,
        )
    return MappedPart(
        reconstruction=reconstruction,
        view=None if view is None else view.reversed() if reverse else view,
        twin=reversed_twin(reconstruction) if sign.status == "ambiguous" else None,
        figures=PartFigures(
            rounds=part.first.rounds,
            reliability=trust,
            diagnostics=Diagnostics(
                sigma_px=refined.sigma_px,
                start=part.start,
                depth_sign_cues=cue_figures(cues, reverse=reverse),
                guided=None if guided is None else guided.figures,
                tilt=part.tilt,
            ),
            notes=(
                *part.notes,
                *notes,
                *(() if uncertainty is None else uncertainty.notes),
                *drag_notes(drag),
                *perspective_notes(perspective, trust.total_rotation_sigma_deg),
            ),
        ),
    )


def rests_on(context: SeriesContext, part: MappedPart) -> Substance:
    """What the model of a part rests on."""
    r, trust = part.reconstruction, part.figures.reliability
    return substance(
        np.asarray(r.points),
        r.point_covariance,
        r.observations.select(r.inlier),
        rotation_deg=trust.total_rotation_deg,
        rotation_sigma_deg=trust.total_rotation_sigma_deg,
        num_given=len(context.image_names),
    )


def cue_figures(cues: Mapping[str, Cue], *, reverse: bool) -> dict[str, CueFigures]:
    """The evidence as seen from the hand that was chosen."""
    return {
        name: CueFigures(t=-cue.t if reverse else cue.t, num_regions=cue.num_regions)
        for name, cue in cues.items()
    }


def cues_of(context: SeriesContext, model: Refined, names: Collection[str]) -> dict[str, Cue]:
    """Some of the cues that images give, on one state of the model."""
    sizes = context.image_size_px[model.images]
    return visibility_cues(model.cameras, model.points, model.observations, sizes, names=names)


def find_cues(context: SeriesContext, refined: Refined, first: Refined) -> dict[str, Cue]:
    """All evidence of the hand: what the tracks see, the shape, the direction of a known tilt."""
    found = {
        **cues_of(context, first, [name for name in CUES if name not in SHAPE_CUES]),
        **cues_of(context, refined, SHAPE_CUES),
    }
    cues = {name: found[name] for name in CUES}
    edge = context.refinement.receding_edge
    # with the stage's rotation the axis of the tilt turns in the specimen: no turn about one axis
    rotates = context.tilt is not None and context.tilt.rotation_rad is not None
    if context.tilt is not None and edge != "unknown" and not rotates:
        known, sigma = known_tilts(context.tilt, context.names_of(refined.images))
        cues["known tilt"] = known_tilt_cue(
            refined.cameras, known, axis_from_receding_edge(edge), float(np.nanmedian(sigma))
        )
    return cues


def to_world(
    context: SeriesContext, part: Settled, covariance: Covariance | None, sign: DepthSign
) -> Reconstruction:
    """The part as a reconstruction in the world that is written, its hand as it was found.

    It holds all observations of the tracks that have a point, in registered images; those that a
    filter rejected are marked.
    """
    refined = part.refined
    cameras, points, point_covariance = in_world(
        refined.cameras,
        refined.points,
        None if covariance is None else covariance.points,
        context.pixel_size_um or 1.0,
    )
    kept = take_exactly(part.observations, refined.images, refined.tracks)
    return Reconstruction(
        image_names=context.names_of(refined.images),
        image_size_px=context.image_size_px[refined.images],
        cameras=cameras,
        points=points,
        observations=kept.observations,
        inlier=refined.inlier[kept.rows],
        point_covariance=point_covariance,
        sigma_rotation_rad=None if covariance is None else covariance.sigma_rotation_rad,
        sigma_translation_px=None if covariance is None else covariance.sigma_translation_px,
        sigma_scale=None if covariance is None else covariance.sigma_scale,
        world_unit="px" if context.pixel_size_um is None else "um",
        pixel_size_um=context.pixel_size_um,
        pixel_size_source=context.pixel_size_source,
        camera_model=context.refinement.camera_model,
        depth_sign=sign,
        gauge=GAUGE,
    )


def in_world(
    cameras: OrthographicCameras, points: Float, covariance: Float | None, unit_per_px: float
) -> tuple[OrthographicCameras, Float, Float | None]:
    """Cameras, points (N, 3) and their covariances in the world that is written.

    Its origin is the centroid, its axes those of the first image, and the mean magnification, of
    the first series where there are several, shows a unit as ``1 / unit_per_px``.
    """
    centre = points.mean(axis=0)
    scale = np.asarray(cameras.scale_px_per_unit)
    if cameras.series_idx is not None:
        scale = scale[cameras.series_idx == cameras.series_idx.min()]
    factor = float(np.exp(np.mean(np.log(scale)))) * unit_per_px
    R0 = np.asarray(cameras.cam_from_world[0])
    moved = replace(
        cameras,
        translation_px=cameras.translation_px + cameras.projection @ centre,
        scale_px_per_unit=cameras.scale_px_per_unit / factor,
        cam_from_world=cameras.cam_from_world @ R0.T,
    )
    turned = None if covariance is None else factor**2 * (R0 @ covariance @ R0.T)
    return moved, (points - centre) @ R0.T * factor, turned


def view_in_world(part: Settled, unit_per_px: float) -> Perspective | None:
    """The perspective that was taken out, about its place in the world that is written."""
    view, refined = part.displacement.view, part.refined
    if view is None:
        return None
    moved = in_world(refined.cameras, np.vstack([refined.points, view.centre]), None, unit_per_px)[
        1
    ]
    # `in_world` takes the mean off, which is that of the points alone
    return replace(view, centre=moved[-1] - moved[:-1].mean(axis=0))


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
