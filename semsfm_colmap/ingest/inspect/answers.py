"""What a series is good for, before anything is reconstructed: short answers with their reasons."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from semsfm_colmap.geometry.rotations import rotation_angle
from semsfm_colmap.ingest.inspect.overlap import Overlap
from semsfm_colmap.ingest.series.pixel_size import SAME_MAGNIFICATION
from semsfm_colmap.ingest.series.refusals import MIN_IMAGES
from semsfm_colmap.io.wording import abbreviate
from semsfm_colmap.motion.prior import MIN_RANGE_DEG
from semsfm_colmap.motion.small_tilt import SMALL_ROTATION_DEG
from semsfm_colmap.motion.stage import stage_rotations

GOOD_IMAGES = 5
"""Three views determine a shape but cannot be checked; from five on errors show."""
MIN_TILT_DEG = 5.0
"""Below this the tilt drowns in any change of magnification."""
MAX_STEP_DEG = 12.0
"""SIFT finds a fifth of the 5-degree matches on rough surfaces at 20 degrees."""
MIN_PARALLAX_PART = 1.2e-3
"""Parallax relative to the image side from which depth shows: about a pixel in a thousand."""
MAGNIFICATION_STEP = 0.03


@dataclass(frozen=True, kw_only=True)
class Answer:
    """One question about a series: yes, no, or unsure, and the sentence that says why."""

    question: str
    answer: str
    reason: str


def answer_all(
    *,
    names: Sequence[str],
    side_px: Sequence[float],
    tilt_deg: Sequence[float | None],
    rotation_deg: Sequence[float | None],
    pixel_size_um: Sequence[float | None],
    overlaps: Sequence[Overlap],
    far_overlaps: Sequence[Overlap],
) -> list[Answer]:
    """The questions in the order a person asks them."""
    return [
        _enough_images(len(names)),
        _overlapping(names, overlaps),
        _enough_tilt(tilt_deg, rotation_deg, side_px, [*overlaps, *far_overlaps]),
        _same_magnification(names, pixel_size_um, overlaps),
    ]


def _enough_images(count: int) -> Answer:
    question = "enough images"
    if count < MIN_IMAGES:
        return Answer(
            question=question,
            answer="no",
            reason=f"{count} usable; two parallel projections leave a family of shapes, "
            f"{MIN_IMAGES} are needed",
        )
    if count < GOOD_IMAGES:
        return Answer(
            question=question,
            answer="just",
            reason=f"{count} determine a shape but leave little to check it by",
        )
    return Answer(question=question, answer="yes", reason=f"{count} usable")


def _overlapping(names: Sequence[str], overlaps: Sequence[Overlap]) -> Answer:
    question = "overlapping"
    if not overlaps:
        return Answer(question=question, answer="unknown", reason="there is nothing to compare")
    fits = [overlap.overlapping for overlap in overlaps]
    if all(fits):
        least = min(overlap.num_agreeing for overlap in overlaps)
        return Answer(
            question=question,
            answer="yes",
            reason=f"every image shares at least {least} features with the next",
        )
    gaps = [f"{a} | {b}" for a, b, fit in zip(names, names[1:], fits, strict=False) if not fit]
    return Answer(
        question=question,
        answer="no" if not any(fits) else "partly",
        reason=f"no common features between {abbreviate(gaps)}: the step is too large there, or "
        "the frames do not belong together",
    )


def _turned_deg(
    tilt_deg: Sequence[float | None], rotation_deg: Sequence[float | None]
) -> tuple[float, float, float] | None:
    """Of a stage that rotated, too: the largest angle between the directions of two views, that
    between neighbours, and the largest rotation, which has a part in the image plane.

    None where the stage only tilted, or too little is known.
    """
    both = [(t, r) for t, r in zip(tilt_deg, rotation_deg, strict=True) if None not in (t, r)]
    if len(both) < 2:
        return None
    tilt, rotation = np.deg2rad(np.array(both, dtype=np.float64)).T
    if np.ptp(rotation) < np.deg2rad(MIN_RANGE_DEG):
        return None
    R = stage_rotations(tilt, rotation)
    # a turn in the image plane shows no depth: what counts is how far the views' directions part
    directions = R[:, 2]
    cosine = np.clip(directions @ directions.T, -1.0, 1.0)
    apart = np.rad2deg(np.arccos(cosine))
    largest = max(float(np.rad2deg(rotation_angle(R @ one.T)).max()) for one in R)
    return float(apart.max()), float(np.diagonal(apart, 1).max()), largest


def _enough_tilt(
    tilt_deg: Sequence[float | None],
    rotation_deg: Sequence[float | None],
    side_px: Sequence[float],
    overlaps: Sequence[Overlap],
) -> Answer:
    question = "enough tilt"
    known = [value for value in tilt_deg if value is not None and math.isfinite(value)]
    spread = max(known) - min(known) if known else 0.0
    turned = _turned_deg(tilt_deg, rotation_deg)
    if turned is not None:
        spread = turned[0]
    of = "" if len(known) == len(tilt_deg) else f" between the {len(known)} images that record it"
    if spread > 0.5:
        largest = turned[1] if turned else float(np.abs(np.diff(np.array(known))).max())
        if turned is not None:
            of += (
                " between directions of view (rotations of up to "
                f"{turned[2]:.1f} degrees by tilt and rotation together)"
            )
        if spread < MIN_TILT_DEG:
            return Answer(
                question=question, answer="no",
                reason=f"{spread:.1f} degrees in all{of}; {SMALL_ROTATION_DEG:.0f} or more are "
                "wanted",
            )  # fmt: skip
        if spread < SMALL_ROTATION_DEG:
            return Answer(
                question=question, answer="just",
                reason=f"{spread:.1f} degrees in all{of}: depths will depend on the tilts recorded "
                "and on a constant magnification",
            )  # fmt: skip
        if largest > MAX_STEP_DEG:
            return Answer(
                question=question, answer="yes",
                reason=f"{spread:.1f} degrees{of}, but steps of up to {largest:.1f} are hard "
                f"to match; {MAX_STEP_DEG:.0f} or less are wanted",
            )  # fmt: skip
        return Answer(
            question=question, answer="yes",
            reason=f"{spread:.1f} degrees{of} in steps of up to {largest:.1f}",
        )  # fmt: skip
    usable = [overlap for overlap in overlaps if overlap.overlapping]
    if not usable:
        return Answer(question=question, answer="unknown", reason="no tilt is recorded")
    parallax = max(overlap.parallax_px for overlap in usable)
    side = float(np.median(np.array(side_px)))
    enough = parallax > MIN_PARALLAX_PART * side
    return Answer(
        question=question,
        answer="unknown" if enough else "no",
        reason=f"no tilt is recorded; parallax of {parallax:.1f} px between frames "
        + (
            "shows depth, but not how far the specimen was turned: "
            f"{SMALL_ROTATION_DEG:.0f} degrees or more are wanted"
            if enough
            else "is too little to show depth"
        ),
    )


def _same_magnification(
    names: Sequence[str], pixel_size_um: Sequence[float | None], overlaps: Sequence[Overlap]
) -> Answer:
    question = "same magnification"
    known = [um for um in pixel_size_um if um is not None]
    if known and max(known) / min(known) - 1 > SAME_MAGNIFICATION:
        return Answer(
            question=question, answer="no",
            reason=f"recorded pixel sizes range from {min(known):.6g} to {max(known):.6g} um",
        )  # fmt: skip
    jumps = [
        name
        for name, overlap in zip(names[1:], overlaps, strict=False)
        if abs(overlap.magnification - 1) > MAGNIFICATION_STEP
    ]
    if jumps:
        return Answer(
            question=question, answer="no",
            reason=f"{abbreviate(jumps)}: larger or smaller than the previous image in both "
            "directions",
        )  # fmt: skip
    if not known and not any(overlap.overlapping for overlap in overlaps):
        return Answer(question=question, answer="unknown", reason="no pixel size is recorded")
    return Answer(
        question=question, answer="yes",
        reason="recorded pixel sizes agree" if known else "the images agree",
    )  # fmt: skip
