"""The numbers as plain sentences: what came out, and what to doubt, the largest first."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from semsfm_colmap.report.doubts import evidence, find_doubts, sentence_of
from semsfm_colmap.report.metrics import Metrics
from semsfm_colmap.report.motion_statistics import RotationMetrics
from semsfm_colmap.report.number_text import (
    count,
    fixed,
    measured,
    number,
    percent,
    unit_text,
)


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """The box at the top of the report."""

    facts: tuple[str, ...]
    doubts: tuple[str, ...]
    """the largest first"""


def _facts(m: Metrics) -> Iterator[str]:
    images, structure, world, r = m.images, m.structure, m.world, m.residuals
    registered = f"{images.num_registered} of {count(images.num_given, 'image')} registered"
    if structure.num_observations == 0:
        yield f"{registered}; {count(structure.num_points, 'point')}."
    else:
        yield (
            f"{registered}; {count(structure.num_points, 'point')} from "
            f"{count(structure.num_observations, 'observation')}, each seen in "
            f"{number(structure.mean_track_length)} images on average."
        )
    if world.unit == "um":
        nm = f"one pixel is {number(world.pixel_size_nm, 4)} nm"
        yield f"The model is in micrometres: {nm} ({world.pixel_size_source})."
    else:
        yield "The model is in pixels: no pixel size is known."
    if r is not None:
        nm = (
            f" ({number(r.x.sigma_nm)} nm in x, {number(r.y.sigma_nm)} nm in y)"
            if r.x.sigma_nm is not None
            else ""
        )
        yield (
            f"Residuals have σ = {number(r.x.sigma_px)} px in x and "
            f"{number(r.y.sigma_px)} px in y{nm}, over "
            f"{count(r.num_residuals, 'kept observation')}."
        )
    if m.rotation is not None:
        sigma = None if m.reliability is None else m.reliability.total_rotation_sigma_deg
        yield from _facts_of_motion(m.rotation, sigma)
    sign = m.depth_sign
    if sign.status == "resolved":
        # the cues say what the program's own sentence does; a user's word they do not
        word = f" {sentence_of(sign.message)}" if "user" in sign.evidence else ""
        yield (
            f"Depth sign: resolved, with a confidence of {percent(sign.confidence)}."
            f"{evidence(sign)}{word}"
        )
    if m.mesh is not None and m.mesh.bounding_box is not None:
        mesh, u = m.mesh, unit_text(world.unit)
        size = " × ".join(number(s) for s in m.mesh.bounding_box.size_world)
        yield (
            f"The mesh has {count(mesh.num_faces, 'face')} in "
            f"{count(mesh.num_components, 'component')}, an area of "
            f"{number(mesh.area_world2)} {u}², and fits a box of {size} {u}."
        )


def _facts_of_motion(rotation: RotationMetrics, sigma_deg: float | None) -> Iterator[str]:
    yield (
        f"The specimen turned through {measured(rotation.range_deg, sigma_deg)}° about one axis, "
        f"in steps of {number(rotation.median_step_deg)}° (median), with a wobble of "
        f"{fixed(rotation.wobble_rms_deg, 2)}° rms."
    )
    closing = rotation.closure
    if closing.is_full_turn:
        yield (
            f"It is a full turn: the step from the last image to the first is "
            f"{number(closing.last_to_first_deg)}°, against a median step of "
            f"{number(closing.median_step_deg)}°."
        )
    tilt = rotation.stage_tilt
    if tilt is not None and tilt.agrees is not False:
        follow = (
            "The angles follow the recorded tilt with"
            if tilt.agrees
            else "Against the recorded tilt, by which they were not judged, the angles have"
        )
        yield (
            f"{follow} a slope of {number(tilt.slope, 4)} and {number(tilt.rms_deg, 2)}° rms "
            f"over {count(tilt.num_images, 'image')}."
        )


def judge(metrics: Metrics) -> Verdict:
    """The facts and the doubts that follow from the metrics."""
    return Verdict(
        facts=tuple(_facts(metrics)),
        doubts=tuple(doubt.sentence for doubt in find_doubts(metrics)),
    )
