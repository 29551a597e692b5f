"""How far to trust a result, in sentences: hand, angles, scale, surface."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping

from semsfm_colmap.records import Reliability
from semsfm_colmap.report.metrics import Metrics
from semsfm_colmap.report.motion_statistics import RotationMetrics
from semsfm_colmap.report.number_text import (
    confidence,
    count,
    measured,
    number,
    percent,
    unit_text,
)
from semsfm_colmap.types import DepthSign

CAUSES = {
    "noise": "noise",
    "clustered": "errors that neighbouring points share",
    "drag": "shading that drags features",
    "shading": "shading",
    "models": "the choice of the camera model",
    "perspective": "perspective",
}
"""The parts of the error bars, as a person says them."""
CONVEX_CUES = frozenset({"near side", "bulge"})
"""Cues of the hand that take the body to be convex."""
DECIDES = 0.9
"""A cue that alone says less does not decide the hand."""
NOTED_PX = 0.1
"""Drift and drag below this are not worth a sentence."""
SAME_RANGE = 0.01
"""Range about the fitted axis and total rotation are the same number up to this share: a full turn
has a range of 360 and a largest rotation of 180 degrees, and their error bars are not the same."""
SAID_OF_THE_RUN = ("shading drags features", "the specimen drifted while the frames were scanned")
"""Beginnings of notes of the run whose numbers stand in these sentences."""


def total_rotation_deg(m: Metrics) -> float:
    """Largest rotation between two images; 0 where nothing turned."""
    if m.reliability is not None and m.reliability.total_rotation_deg > 0.0:
        return m.reliability.total_rotation_deg
    return 0.0 if m.rotation is None else m.rotation.range_deg


def relative_sigma(m: Metrics) -> float:
    """Standard deviation of the total rotation over itself; infinite where none is known."""
    trust = m.reliability
    if trust is None or trust.total_rotation_sigma_parts_deg is None:
        return math.inf
    return trust.total_rotation_sigma_deg / max(trust.total_rotation_deg, 1e-12)


def disagreement(m: Metrics) -> float:
    """Relative difference between the camera models that the images do not rule out."""
    return 0.0 if m.reliability is None else m.reliability.depth_uncertainty


def largest_drift_px(m: Metrics) -> float:
    """The largest drift within a frame that was taken out of the observations."""
    drift = None if m.reliability is None else m.reliability.drift_px
    return max((abs(value) for pair in (drift or {}).values() for value in pair), default=0.0)


def evidence(sign: DepthSign) -> str:
    """What each cue says of the hand."""
    cues = ", ".join(f"{cue} {confidence(p)}" for cue, p in sign.evidence.items() if cue != "user")
    return f" Evidence: {cues}." if cues else " There is no evidence either way."


def sentence_of(message: str) -> str:
    """A message of the run, without the figures in brackets that stand beside it already."""
    plain = re.sub(r" \([^)]*\)", "", message).rstrip(".")
    plain = re.sub(r" of confidence [\d.]+", "", plain)
    return f"{plain[:1].upper()}{plain[1:]}." if plain else ""


def systematic(parts: Mapping[str, float]) -> str:
    """``; noise alone would be 0.03 deg``, where noise is the smaller part."""
    noise = parts.get("noise", 0.0)
    others = math.sqrt(sum(part**2 for name, part in parts.items() if name != "noise"))
    if noise <= 0.0 or others <= noise:
        return ""
    return f" (noise alone would be ± {number(noise, 1)}°)"


def convexity_decides(sign: DepthSign) -> bool:
    """True where nothing but the bulge of the specimen tells its hand."""
    return sign.status == "resolved" and not any(
        p > DECIDES for cue, p in sign.evidence.items() if cue not in CONVEX_CUES
    )


def _of_hand(sign: DepthSign) -> Iterator[str]:
    if sign.status != "resolved":
        return
    if "user" in sign.evidence:
        yield f"The hand (depth sign) is as you gave it.{evidence(sign)}"
        return
    bent = ""
    if convexity_decides(sign):
        bent = (
            " It rests on the specimen bulging toward the viewer: of a hollow one the model would "
            "be inside out, and a known direction of the tilt would tell "
            "(--refinement.receding_edge)."
        )
    yield (
        f"Depth sign: resolved. The hand is right with {confidence(sign.confidence)} "
        f"confidence.{evidence(sign)}{bent}"
    )


def _of_rotation(trust: Reliability) -> Iterator[str]:
    parts, total = trust.total_rotation_sigma_parts_deg, trust.total_rotation_deg
    sigma = trust.total_rotation_sigma_deg
    if parts is None or total <= 0.0 or sigma <= 0.0:
        return
    largest = max(parts, key=lambda name: parts[name])
    yield (
        f"The total rotation is known to ± {number(sigma, 2)}° ({percent(sigma / total)}), and "
        f"depths to the same share; most of it is {CAUSES.get(largest, largest)}"
        f"{systematic(parts)}."
    )
    if trust.models and trust.depth_uncertainty <= max(0.01, sigma / total):
        yield (
            "Camera models that the images do not rule out agree on the total rotation within "
            f"{percent(trust.depth_uncertainty, 2)}."
        )


def _of_known_tilt(rotation: RotationMetrics | None) -> Iterator[str]:
    tilt = None if rotation is None else rotation.stage_tilt
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


def _of_magnification(m: Metrics) -> Iterator[str]:
    trend = m.magnification_trend
    view = None if m.reliability is None else m.reliability.perspective
    if trend is None or not trend.is_found or (view is not None and view.used):
        return
    if not trend.is_doubtful(disagreement(m), relative_sigma(m)):
        yield (
            f"The magnification runs with the angle by {percent(trend.span, 2)}, no more than that "
            "of a microscope may, and the angles do not hang on it."
        )


def _of_what_was_taken_out(m: Metrics, trust: Reliability) -> Iterator[str]:
    drift, drag, view = largest_drift_px(m), trust.drag, trust.perspective
    taken = []
    if drift >= NOTED_PX:
        taken.append(f"a drift within the frames of up to {number(drift, 2)} px")
    if drag is not None and abs(drag.coefficient_px) >= max(NOTED_PX, 2.0 * drag.sigma_px):
        taken.append(f"the drag of the shading ({measured(drag.coefficient_px, drag.sigma_px)} px)")
    if view is not None and view.used:
        taken.append(f"perspective (which changed the rotation by {number(view.change_deg, 2)}°)")
    if taken:
        yield (
            f"Taken out of the observations: {', '.join(taken)}. What is not known of it is in "
            "the error bars."
        )


def trust_sentences(m: Metrics) -> Iterator[str]:
    """Sentences in their order: hand, angles, what was taken out, scale, surface."""
    yield from _of_hand(m.depth_sign)
    if m.reliability is not None:
        yield from _of_rotation(m.reliability)
    yield from _of_known_tilt(m.rotation)
    if m.reliability is not None:
        yield from _of_magnification(m)
        yield from _of_what_was_taken_out(m, m.reliability)
    if m.world.unit == "um":
        yield (
            f"Lengths are as right as the pixel size ({m.world.pixel_size_source}); makers give "
            "theirs to 1 to 3 %, and no image tells more."
        )
    cloud = m.cloud
    if cloud is not None and cloud.median_sigma_world is not None:
        unit = unit_text(m.world.unit)
        middle, most = number(cloud.median_sigma_world, 2), number(cloud.p95_sigma_world, 2)
        yield (
            f"Places of the surface are known along its normal to {middle} {unit} (median; 95 % "
            f"to {most} {unit})."
        )
