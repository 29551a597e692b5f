"""Doubts about the depth: its hand, and the angles that it is proportional to."""

from __future__ import annotations

from collections.abc import Iterator

from semsfm_colmap.motion.small_tilt import SMALL_ROTATION_DEG
from semsfm_colmap.records import Reliability
from semsfm_colmap.report.doubt import WHOLE, Doubt
from semsfm_colmap.report.metrics import Metrics
from semsfm_colmap.report.number_text import confidence, measured, number, percent
from semsfm_colmap.report.trust_text import (
    CAUSES,
    evidence,
    sentence_of,
    systematic,
    total_rotation_deg,
)

MAX_RELATIVE_SIGMA = 0.01
"""A total rotation less certain than one percent is worth a sentence: depths are as uncertain."""
MAX_WOBBLE_FRACTION = 0.1
"""A wobble above a tenth of the range is not a rotation about one axis any more."""
SMALL_ROTATION_SIZE = 0.03
"""Relative error of the angles below `SMALL_ROTATION_DEG`, where no error bar says more."""
TURN_FURTHER = (
    "turn the specimen further, or give known tilts (a table with tilt_deg as --series_csv, or "
    "--tilt_step_deg); `semsfm plan --project PROJECT` says which angles to add"
)
CURES = {
    "noise": "add images, or sharper ones: noise is the one part that more of them reduce",
    "clustered": "give more of the surface, or more images at other angles",
    "drag": "turn the specimen further or give known tilts: more images do not help against "
    "shading",
    "shading": "turn the specimen further or give known tilts: more images do not help against "
    "shading",
    "models": "turn the specimen further or give known tilts",
    "perspective": "image at a longer working distance, or compare --refinement.perspective",
}
"""What would lower each part of the error bar."""


def _doubts_about_hand(m: Metrics) -> Iterator[Doubt]:
    sign = m.depth_sign
    tilts_known = m.rotation is not None and m.rotation.stage_tilt is not None
    look = (
        "open sparse/0 and sparse/1: in the wrong one bumps are pits; then say --depth_sign as_is "
        "or --depth_sign reversed"
    )
    if sign.status != "resolved":
        if tilts_known and sign.evidence.get("known tilt", 0.5) == 0.5:
            look = (
                "say which edge of the image goes away from the viewer as the recorded tilt grows "
                f"(--refinement.receding_edge bottom, top, left or right); or {look}"
            )
        twin = (
            " Both models are written: sparse/0 and its depth-reversed twin sparse/1."
            if m.twin_written
            else " The depth-reversed twin was not written."
        )
        yield Doubt(
            size=WHOLE,
            title="the hand is open: the model may be inside out",
            sentence=(
                "The depth sign is ambiguous: the model may be inside out, near for far. The "
                f"first model is right with {confidence(sign.confidence)} confidence."
                f"{evidence(sign)}{twin}"
            ),
            action=look,
            covers=("sparse/1 holds the depth-reversed twin",),
        )
    elif "against evidence" in sign.message:
        yield Doubt(
            size=WHOLE,
            title="your word on the hand stands against the evidence",
            sentence=f"{sentence_of(sign.message)}{evidence(sign)}",
            action="look at the model again; --depth_sign auto lets the evidence decide",
        )


def _doubts_about_motion(m: Metrics) -> Iterator[Doubt]:
    """Doubts about the rotation of two or more images."""
    rotation, trust = m.rotation, m.reliability
    total = total_rotation_deg(m)
    tilt = None if rotation is None else rotation.stage_tilt
    if tilt is not None and tilt.agrees is False:
        yield Doubt(
            size=abs(tilt.slope - 1.0),
            title="recorded tilts and images disagree",
            sentence=(
                f"The images turned {number(tilt.slope, 4)} times as far as the recorded tilts "
                "say, more than either can be wrong; the tilts were left out."
            ),
            action="check the recorded tilts, and whether the magnification changed",
        )
    followed = tilt is not None and tilt.agrees is True
    if total < SMALL_ROTATION_DEG and not followed:
        sigma = None if trust is None else trust.total_rotation_sigma_deg
        known = "" if not sigma else f", so that depths are uncertain by {percent(sigma / total)}"
        yield Doubt(
            size=max(SMALL_ROTATION_SIZE, sigma / total if sigma else 0.0),
            title=f"the specimen turned by only {measured(total, sigma, 3)} deg",
            sentence=(
                f"The whole rotation is only {measured(total, sigma, 3)}°{known}. Below "
                f"{SMALL_ROTATION_DEG:.0f}° the angles and depths may be off by several percent "
                "although the residuals are small."
            ),
            action=TURN_FURTHER,
            covers=("the total rotation is only",),
        )
    elif rotation is not None and rotation.wobble_rms_deg > MAX_WOBBLE_FRACTION * total:
        wobble = rotation.wobble_rms_deg
        yield Doubt(
            size=wobble / max(total, wobble),
            title="the rotation is not about one axis",
            sentence=(
                f"The rotation is not about one axis: its wobble is {number(wobble)}° rms in "
                f"{number(rotation.range_deg)}° of range. The angles per image mean little."
            ),
            action="look for images that jump in the figure of the rotation and leave them out; "
            "of a series about several axes trust poses and points, not the angles of this page",
        )


def _doubts_about_sigma(m: Metrics, trust: Reliability) -> Iterator[Doubt]:
    """What the error bars and the camera models say of the total rotation."""
    total, sigma = trust.total_rotation_deg, trust.total_rotation_sigma_deg
    parts = trust.total_rotation_sigma_parts_deg
    relative = sigma / total
    tilt = None if m.rotation is None else m.rotation.stage_tilt
    small = total < SMALL_ROTATION_DEG and not (tilt is not None and tilt.agrees is True)
    if parts is None:
        yield Doubt(
            size=WHOLE,
            title="there are no error bars",
            sentence="No error bars can be given: some angles are not determined by the images.",
            action=TURN_FURTHER,
        )
    elif relative > MAX_RELATIVE_SIGMA and not small:
        largest = max(parts, key=lambda name: parts[name])
        yield Doubt(
            size=relative,
            title=f"the total rotation is uncertain by {percent(relative)}",
            sentence=f"The total rotation is {measured(total, sigma)}°, so that depths and angles "
            f"are uncertain by {percent(relative)}, most of it from "
            f"{CAUSES.get(largest, largest)}{systematic(parts)}.",
            action=CURES.get(largest, TURN_FURTHER),
        )
    if trust.depth_uncertainty > max(MAX_RELATIVE_SIGMA, relative):
        ranges = ", ".join(f"{rung.name} {number(rung.range_deg)}°" for rung in trust.models)
        listed = f" (all: {ranges})" if ranges else ""
        yield Doubt(
            size=trust.depth_uncertainty,
            title=f"camera models differ by {percent(trust.depth_uncertainty)}",
            sentence="Camera models that the images do not rule out differ in the total rotation, "
            f"and the depths with it, by {percent(trust.depth_uncertainty)}{listed}.",
            action="a larger tilt or known tilts settle it: " + TURN_FURTHER,
            covers=("the camera models that fit disagree",),
        )


def doubts_about_depth(m: Metrics) -> Iterator[Doubt]:
    """Hand, number of views, rotation and its error bars."""
    num, trust = m.images.num_registered, m.reliability
    if num < 2:
        return
    yield from _doubts_about_hand(m)
    if num == 2:
        yield Doubt(
            size=WHOLE,
            title="two views leave the depth scale open",
            sentence=(
                "Two parallel views leave the depth scale and the angle between them undetermined: "
                "without a known angle the shape is a guess."
            ),
            action="add a third image at another angle",
        )
    yield from _doubts_about_motion(m)
    if num > 2 and trust is not None and trust.total_rotation_deg > 0.0:
        yield from _doubts_about_sigma(m, trust)
