"""The numbers as plain sentences: what came out, and what to doubt, each with its evidence."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from semsfm_colmap.motion.small_tilt import SMALL_ROTATION_DEG
from semsfm_colmap.report.metrics import Metrics
from semsfm_colmap.report.motion_statistics import RotationMetrics
from semsfm_colmap.report.number_text import count, fixed, listed, number, percent, unit_text
from semsfm_colmap.types import DepthSign

MAX_SCALE_SPREAD = 0.003
"""Magnification drift of scanning electron microscopes within a series is 0.05 to 0.3 %."""
MIN_SHARED_TRACKS = 10
"""A window of the factorization needs this many common tracks to hold its images together."""
MAX_WOBBLE_FRACTION = 0.1
"""A wobble above a tenth of the range is not a rotation about one axis any more."""
MAX_REJECTED_FRACTION = 0.3
"""RANSAC and the filters are built for matches of which most are right."""
BAD_IMAGE_FACTOR = 2.0
"""An image whose residuals are this many times the median of all stands out."""
MIN_MULTI_VIEW_FRACTION = 0.5
"""Points seen twice add nothing to the metric shape; half of them should be seen more often."""
MAX_SCALE_MISMATCH = 0.01
"""Pixel size and model scale must agree: the vendors' pixel sizes are good to 1 to 3 %, but both
come from the same number."""


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """The box at the top of the report."""

    facts: tuple[str, ...]
    doubts: tuple[str, ...]


def _evidence(sign: DepthSign) -> str:
    cues = ", ".join(f"{cue} {percent(p)}" for cue, p in sign.evidence.items())
    return f" Evidence: {cues}." if cues else " There is no evidence either way."


def _sentence(message: str) -> str:
    """A message of the run, without the figures in brackets that stand beside it already."""
    plain = re.sub(r" \([^)]*\)", "", message).rstrip(".")
    return f"{plain[:1].upper()}{plain[1:]}." if plain else ""


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
        yield from _facts_of_motion(m.rotation)
    sign = m.depth_sign
    if sign.status == "resolved":
        # the cues say what the program's own sentence does; a user's word they do not
        word = f" {_sentence(sign.message)}" if "user" in sign.evidence else ""
        yield (
            f"Depth sign: resolved, with a confidence of {percent(sign.confidence)}."
            f"{_evidence(sign)}{word}"
        )
    if m.mesh is not None and m.mesh.bounding_box is not None:
        mesh, u = m.mesh, unit_text(world.unit)
        size = " × ".join(number(s) for s in m.mesh.bounding_box.size_world)
        yield (
            f"The mesh has {count(mesh.num_faces, 'face')} in "
            f"{count(mesh.num_components, 'component')}, an area of "
            f"{number(mesh.area_world2)} {u}², and fits a box of {size} {u}."
        )


def _facts_of_motion(rotation: RotationMetrics) -> Iterator[str]:
    yield (
        f"The specimen turned through {number(rotation.range_deg, 4)}° about one axis, in "
        f"steps of {number(rotation.median_step_deg)}° (median), with a wobble of "
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


def _doubts_about_depth(m: Metrics) -> Iterator[str]:
    sign, num = m.depth_sign, m.images.num_registered
    if num < 2:
        return
    if sign.status != "resolved":
        twin = (
            " Both models are written: sparse/0 and its depth-reversed twin sparse/1."
            if m.twin_written
            else " The depth-reversed twin was not written."
        )
        yield (
            f"The depth sign is ambiguous: the model may be inside out, near for far. The first "
            f"model has a confidence of {percent(sign.confidence)}.{_evidence(sign)}{twin} "
            f"{_sentence(sign.message)}".rstrip()
        )
    if num == 2:
        yield (
            "Two parallel views leave the depth scale and the angle between them undetermined: "
            "without a known angle the shape is a guess. Add a third image."
        )
    yield from _doubts_about_motion(m.rotation)


def _doubts_about_motion(rotation: RotationMetrics | None) -> Iterator[str]:
    """Doubts about the rotation of two or more images; None where nothing turned."""
    range_deg = 0.0 if rotation is None else rotation.range_deg
    tilt = None if rotation is None else rotation.stage_tilt
    if tilt is not None and tilt.agrees is False:
        yield (
            f"The images turned {number(tilt.slope, 4)} times as far as the "
            "recorded tilts say, more than either can be wrong: check the tilts, or whether the "
            "magnification changed."
        )
    if range_deg < SMALL_ROTATION_DEG:
        yield (
            f"The whole rotation is only {number(range_deg)}°. Below "
            f"{SMALL_ROTATION_DEG:.0f}° the angles and depths may be off by several percent "
            "although the residuals are small."
        )
    elif rotation is not None:
        wobble = rotation.wobble_rms_deg
        if wobble > MAX_WOBBLE_FRACTION * range_deg:
            yield (
                f"The rotation is not about one axis: its wobble is {number(wobble)}° rms in "
                f"{number(range_deg)}° of range. The angles per image mean little."
            )


def _doubts_about_images(m: Metrics) -> Iterator[str]:
    missing = m.images.missing
    if missing:
        yield f"{count(len(missing), 'image')} could not be registered: {listed(missing)}."
    rows = [(image.name, image.pose) for image in m.per_image if image.pose is not None]
    rms = np.array([pose.rms_px or np.nan for _, pose in rows])
    if np.isfinite(rms).any():
        bad = rms > BAD_IMAGE_FACTOR * np.nanmedian(rms)
        names = [name for (name, _), is_bad in zip(rows, bad, strict=True) if is_bad]
        if names:
            yield (
                f"{count(len(names), 'image')} with residuals over {BAD_IMAGE_FACTOR:.0f} times "
                f"the median of all ({number(float(np.nanmedian(rms)))} px): {listed(names)}."
            )
    scale = np.array([pose.relative_scale for _, pose in rows])
    if len(scale) and np.ptp(scale) > 2.0 * MAX_SCALE_SPREAD:
        yield (
            f"The magnification spreads over {percent(float(np.ptp(scale)), 2)} between images; "
            f"more than ±{percent(MAX_SCALE_SPREAD)} is unusual for a microscope left alone, and "
            "a wrong magnification bends the angles."
        )
    shared = np.diagonal(m.co_visibility.num_shared_tracks, offset=1)
    weak = np.flatnonzero(shared < MIN_SHARED_TRACKS)
    if len(weak):
        links = [f"{rows[k][0]} – {rows[k + 1][0]}" for k in weak]
        yield (
            f"Weak links, with fewer than {MIN_SHARED_TRACKS} points shared by neighbouring "
            f"images: {listed(links)}."
        )


def _doubts_about_points(m: Metrics) -> Iterator[str]:
    structure, world, r = m.structure, m.world, m.residuals
    if structure.num_points == 0:
        yield "There are no points: no image could be placed in space."
        return
    fraction = structure.num_points_in_3_or_more_images / structure.num_points
    if fraction < MIN_MULTI_VIEW_FRACTION:
        yield (
            f"Only {percent(fraction)} of the points are seen in three or more images; the others "
            "add nothing to the metric shape."
        )
    rejected = structure.rejected_fraction
    if rejected is not None and rejected > MAX_REJECTED_FRACTION:
        yield f"{percent(rejected)} of all observations were rejected as outliers."
    scale, nm = world.median_scale_px_per_world, world.pixel_size_nm
    if world.unit == "um" and nm is not None and scale is not None:
        ratio = scale * nm / 1000.0
        if abs(ratio - 1.0) > MAX_SCALE_MISMATCH:
            yield (
                f"The scale of the model and the pixel size disagree by a factor of "
                f"{number(ratio, 4)}: lengths in micrometres are off by as much."
            )
    if m.telecentric is not None and r is not None:
        deviation, sigma = m.telecentric.max_deviation_px, r.rms_per_coordinate_px
        if deviation > sigma:
            yield (
                f"The pinhole camera written for COLMAP departs from parallel projection by up to "
                f"{number(deviation)} px, more than the residuals ({number(sigma)} px)."
            )


def judge(metrics: Metrics) -> Verdict:
    """The facts and the doubts that follow from the metrics."""
    doubts = (
        *_doubts_about_depth(metrics),
        *_doubts_about_images(metrics),
        *_doubts_about_points(metrics),
    )
    return Verdict(facts=tuple(_facts(metrics)), doubts=doubts)
