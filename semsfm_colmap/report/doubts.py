"""What to doubt in a result: each doubt with its evidence and its size.

The size is the relative error of lengths, depths or angles that a doubt may stand for; what costs
images or points but no accuracy has a small one.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from semsfm_colmap.motion.small_tilt import SMALL_ROTATION_DEG
from semsfm_colmap.report.metrics import Metrics
from semsfm_colmap.report.motion_statistics import RotationMetrics
from semsfm_colmap.report.number_text import count, listed, measured, number, percent
from semsfm_colmap.types import DepthSign

MAX_RELATIVE_SIGMA = 0.01
"""A total rotation less certain than one percent is worth a sentence: depths are as uncertain."""
CAUSES = {
    "noise": "noise",
    "clustered": "errors that neighbouring points share",
    "drag": "shading that drags features",
    "shading": "shading",
    "models": "the choice of the camera model",
    "perspective": "perspective",
}
"""The parts of the error bars, as a person says them."""
WHOLE = 1.0
"""Size of a doubt about the whole model."""
BEND = 0.1
"""Relative error of the angles for each relative change of the magnification that a model leaves
out, at some tens of degrees."""
NO_ERROR = 0.001
"""Size of a doubt that makes the model smaller, not wrong."""
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
class Doubt:
    """What may be wrong, and by how much."""

    size: float
    """relative error of lengths, depths or angles"""
    sentence: str


def evidence(sign: DepthSign) -> str:
    """What each cue says of the hand."""
    cues = ", ".join(f"{cue} {percent(p)}" for cue, p in sign.evidence.items())
    return f" Evidence: {cues}." if cues else " There is no evidence either way."


def sentence_of(message: str) -> str:
    """A message of the run, without the figures in brackets that stand beside it already."""
    plain = re.sub(r" \([^)]*\)", "", message).rstrip(".")
    return f"{plain[:1].upper()}{plain[1:]}." if plain else ""


def _doubts_about_depth(m: Metrics) -> Iterator[Doubt]:
    sign, num = m.depth_sign, m.images.num_registered
    if num < 2:
        return
    if sign.status != "resolved":
        twin = (
            " Both models are written: sparse/0 and its depth-reversed twin sparse/1."
            if m.twin_written
            else " The depth-reversed twin was not written."
        )
        yield Doubt(
            size=WHOLE,
            sentence=(
                "The depth sign is ambiguous: the model may be inside out, near for far. The "
                f"first model has a confidence of {percent(sign.confidence)}.{evidence(sign)}"
                f"{twin} {sentence_of(sign.message)}".rstrip()
            ),
        )
    if num == 2:
        yield Doubt(
            size=WHOLE,
            sentence=(
                "Two parallel views leave the depth scale and the angle between them undetermined: "
                "without a known angle the shape is a guess. Add a third image."
            ),
        )
    yield from _doubts_about_motion(m.rotation)


def _doubts_about_motion(rotation: RotationMetrics | None) -> Iterator[Doubt]:
    """Doubts about the rotation of two or more images; None where nothing turned."""
    range_deg = 0.0 if rotation is None else rotation.range_deg
    tilt = None if rotation is None else rotation.stage_tilt
    if tilt is not None and tilt.agrees is False:
        yield Doubt(
            size=abs(tilt.slope - 1.0),
            sentence=(
                f"The images turned {number(tilt.slope, 4)} times as far as the "
                "recorded tilts say, more than either can be wrong: check the tilts, or whether "
                "the magnification changed."
            ),
        )
    if range_deg < SMALL_ROTATION_DEG:
        yield Doubt(
            size=0.03,
            sentence=(
                f"The whole rotation is only {number(range_deg)}°. Below "
                f"{SMALL_ROTATION_DEG:.0f}° the angles and depths may be off by several percent "
                "although the residuals are small."
            ),
        )
    elif rotation is not None:
        wobble = rotation.wobble_rms_deg
        if wobble > MAX_WOBBLE_FRACTION * range_deg:
            yield Doubt(
                size=wobble / range_deg,
                sentence=(
                    f"The rotation is not about one axis: its wobble is {number(wobble)}° rms in "
                    f"{number(range_deg)}° of range. The angles per image mean little."
                ),
            )


def _doubts_about_images(m: Metrics) -> Iterator[Doubt]:
    missing = m.images.missing
    if missing:
        yield Doubt(
            size=NO_ERROR,
            sentence=(
                f"{count(len(missing), 'image')} could not be registered: {listed(missing)}."
            ),
        )
    rows = [(image.name, image.pose) for image in m.per_image if image.pose is not None]
    rms = np.array([pose.rms_px or np.nan for _, pose in rows])
    if np.isfinite(rms).any():
        bad = rms > BAD_IMAGE_FACTOR * np.nanmedian(rms)
        names = [name for (name, _), is_bad in zip(rows, bad, strict=True) if is_bad]
        if names:
            yield Doubt(
                size=0.01,
                sentence=(
                    f"{count(len(names), 'image')} with residuals over {BAD_IMAGE_FACTOR:.0f} "
                    f"times the median of all ({number(float(np.nanmedian(rms)))} px): "
                    f"{listed(names)}."
                ),
            )
    scale = np.array([pose.relative_scale for _, pose in rows])
    seen = None if m.reliability is None else m.reliability.perspective
    # with perspective each image has a distance of its own
    alike = seen is None or not seen.used
    if alike and len(scale) and np.ptp(scale) > 2.0 * MAX_SCALE_SPREAD:
        yield Doubt(
            size=BEND * float(np.ptp(scale)),
            sentence=(
                f"The magnification spreads over {percent(float(np.ptp(scale)), 2)} between "
                f"images; more than ±{percent(MAX_SCALE_SPREAD)} is unusual for a microscope left "
                "alone, and a wrong magnification bends the angles."
            ),
        )
    shared = np.diagonal(m.co_visibility.num_shared_tracks, offset=1)
    weak = np.flatnonzero(shared < MIN_SHARED_TRACKS)
    if len(weak):
        links = [f"{rows[k][0]} – {rows[k + 1][0]}" for k in weak]
        yield Doubt(
            size=0.01,
            sentence=(
                f"Weak links, with fewer than {MIN_SHARED_TRACKS} points shared by neighbouring "
                f"images: {listed(links)}."
            ),
        )


def _doubts_about_points(m: Metrics) -> Iterator[Doubt]:
    structure, world, r = m.structure, m.world, m.residuals
    if structure.num_points == 0:
        yield Doubt(
            size=2.0 * WHOLE, sentence=("There are no points: no image could be placed in space.")
        )
        return
    fraction = structure.num_points_in_3_or_more_images / structure.num_points
    if fraction < MIN_MULTI_VIEW_FRACTION:
        yield Doubt(
            size=NO_ERROR,
            sentence=(
                f"Only {percent(fraction)} of the points are seen in three or more images; the "
                "others add nothing to the metric shape."
            ),
        )
    rejected = structure.rejected_fraction
    if rejected is not None and rejected > MAX_REJECTED_FRACTION:
        yield Doubt(
            size=0.01,
            sentence=(f"{percent(rejected)} of all observations were rejected as outliers."),
        )
    scale, nm = world.median_scale_px_per_world, world.pixel_size_nm
    if world.unit == "um" and nm is not None and scale is not None:
        ratio = scale * nm / 1000.0
        if abs(ratio - 1.0) > MAX_SCALE_MISMATCH:
            yield Doubt(
                size=abs(ratio - 1.0),
                sentence=(
                    f"The scale of the model and the pixel size disagree by a factor of "
                    f"{number(ratio, 4)}: lengths in micrometres are off by as much."
                ),
            )
    if m.telecentric is not None and r is not None:
        deviation, sigma = m.telecentric.max_deviation_px, r.rms_per_coordinate_px
        if deviation > sigma:
            yield Doubt(
                size=NO_ERROR,
                sentence=(
                    "The pinhole camera written for COLMAP departs from parallel projection by up "
                    f"to {number(deviation)} px, more than the residuals ({number(sigma)} px)."
                ),
            )


def _doubts_about_rotation(m: Metrics) -> Iterator[Doubt]:
    """What the error bars and the camera models say of the total rotation."""
    trust = m.reliability
    if trust is None or trust.total_rotation_deg <= 0.0 or m.images.num_registered < 3:
        return
    total, sigma = trust.total_rotation_deg, trust.total_rotation_sigma_deg
    parts = trust.total_rotation_sigma_parts_deg
    relative = sigma / total
    if parts is None:
        yield Doubt(
            size=WHOLE,
            sentence="No error bars can be given: some angles are not determined by the images.",
        )
    elif relative > MAX_RELATIVE_SIGMA:
        largest = max(parts, key=lambda name: parts[name])
        yield Doubt(
            size=relative,
            sentence=f"The total rotation is {measured(total, sigma)}°, so that depths and angles "
            f"are uncertain by {percent(relative)}, most of it from "
            f"{CAUSES.get(largest, largest)}.",
        )
    if trust.depth_uncertainty > max(MAX_RELATIVE_SIGMA, relative):
        ranges = ", ".join(f"{rung.name} {number(rung.range_deg)}°" for rung in trust.models)
        yield Doubt(
            size=trust.depth_uncertainty,
            sentence="Camera models that the images do not rule out differ in the total rotation, "
            f"and the depths with it, by {percent(trust.depth_uncertainty)} (all: {ranges}).",
        )


def find_doubts(metrics: Metrics) -> list[Doubt]:
    """All doubts, the largest first."""
    found = (
        *_doubts_about_depth(metrics),
        *_doubts_about_rotation(metrics),
        *_doubts_about_images(metrics),
        *_doubts_about_points(metrics),
    )
    return sorted(found, key=lambda doubt: -doubt.size)
