"""What a series is good for, before anything is reconstructed: short answers with their reasons."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from semsfm_colmap.ingest.checks import MIN_IMAGES
from semsfm_colmap.ingest.overlap import Overlap, ReducedFeatures, find_overlap
from semsfm_colmap.ingest.pixel_size import SAME_MAGNIFICATION
from semsfm_colmap.ingest.wording import abbreviate
from semsfm_colmap.types import Float

GOOD_IMAGES = 5
"""Three views determine a shape but cannot be checked; from five on errors show."""
MIN_TILT_DEG, GOOD_TILT_DEG = 5.0, 15.0
"""Below some 15 degrees a change of magnification mimics a change of the angle."""
MAX_STEP_DEG = 12.0
"""SIFT finds a fifth of the 5-degree matches on rough surfaces at 20 degrees."""
MIN_PARALLAX_PART = 1.2e-3
"""Parallax relative to the image side from which depth shows: about a pixel in a thousand."""
MAGNIFICATION_STEP = 0.03
SHEAR = 8e-3
"""Shear of a frame against both neighbours: drift of 8 px over 1000 rows."""
MIN_OTHER_STEPS = 3
SHEAR_SPREAD = 3.0
"""Steps of shear below so many standard deviations of the others' are noise of the fit."""
MOVED_PART = 0.3
"""Shift between frames, relative to the image side, above which the overlap gets small."""


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
    pixel_size_um: Sequence[float | None],
    overlaps: Sequence[Overlap],
    far_overlaps: Sequence[Overlap],
) -> list[Answer]:
    """The questions in the order a person asks them."""
    return [
        _enough_images(len(names)),
        _overlapping(names, overlaps),
        _enough_tilt(tilt_deg, side_px, [*overlaps, *far_overlaps]),
        _same_magnification(names, pixel_size_um, overlaps),
    ]


def drifted(
    names: Sequence[str], side_px: Sequence[float], overlaps: Sequence[Overlap]
) -> dict[str, str]:
    """Frames that drifted while they were scanned, or between frames.

    Drift within a frame shears it: x changes linearly with the row, while the rows, along which the
    beam is fast, stay straight; so a turn of the frame is where the rows went. The shear between
    consecutive frames is the difference of theirs, plus what the rotation of the specimen does,
    which changes slowly, and what parallax does to the fit, which is noise. A frame that has
    drifted therefore has a step of shear before it and the opposite one after it, both beyond the
    noise of the others.
    """
    notes: dict[str, str] = {}
    steps = np.array(
        [_shear(o.linear) if o.overlapping and o.linear is not None else np.nan for o in overlaps]
    )
    for i, shear in enumerate(_sticking_out(steps)):
        if shear:
            notes[names[i]] = (
                f"drifted while scanned: sheared by {100 * shear:+.1f} % against its neighbours"
            )
    for i, overlap in enumerate(overlaps):
        if overlap.overlapping and overlap.shift_px is not None:
            shift = float(np.hypot(*overlap.shift_px))
            if shift > MOVED_PART * side_px[i + 1]:
                notes.setdefault(
                    names[i + 1], f"moved by {shift:.0f} px against the previous frame"
                )
    return notes


def _shear(linear: Float) -> float:
    """Shear of x with the row in an affine map (2, 2), after undoing its turn of the rows."""
    along = linear[:, 0] / max(float(np.hypot(*linear[:, 0])), 1e-12)
    across = float(along[0] * linear[1, 1] - along[1] * linear[0, 1])
    return float(along @ linear[:, 1]) / max(abs(across), 1e-12)


def _sticking_out(steps: Float) -> list[float]:
    """For each frame how far it is sheared against both neighbours; 0 where that is no drift.

    `steps` (M - 1,) is the shear of each frame against the one before, nan where unknown. The first
    and the last frame have one neighbour only: their step must stand out while the next one does
    not.
    """
    count = len(steps)
    out = [0.0] * (count + 1)
    for i in range(count + 1):
        beside = [j for j in (i - 1, i) if 0 <= j < count]
        others = np.delete(steps, beside)
        others = others[np.isfinite(others)]
        if len(others) < MIN_OTHER_STEPS:
            continue
        level = float(np.median(others))
        limit = max(SHEAR, SHEAR_SPREAD * 1.4826 * float(np.median(np.abs(others - level))))
        before, after = (float(v) - level for v in (steps[max(i - 1, 0)], steps[min(i, count - 1)]))
        if 0 < i < count:
            if before * after < 0 and min(abs(before), abs(after)) > limit:
                out[i] = (before - after) / 2
            continue
        step, next_step = (-after, steps[1] - level) if i == 0 else (before, steps[-2] - level)
        if abs(step) > limit and abs(next_step) <= limit:
            out[i] = step
    return out


def strangers(
    names: Sequence[str], features: Sequence[ReducedFeatures], overlaps: Sequence[Overlap]
) -> list[str]:
    """Frames that share nothing with those around them, in a series that mostly hangs together.

    A frame beside a stranger has a bad neighbour, too, so the frames after next are asked as well.
    """
    count = len(names)
    fits = [overlap.overlapping for overlap in overlaps]
    if not any(fits):
        return []
    lonely = []
    for i in range(count):
        near = [fits[j] for j in (i - 1, i) if 0 <= j < len(fits)]
        if any(near):
            continue
        after_next = [j for j in (i - 2, i + 2) if 0 <= j < count]
        if not any(find_overlap(features[i], features[j]).overlapping for j in after_next):
            lonely.append(names[i])
    return lonely


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


def _enough_tilt(
    tilt_deg: Sequence[float | None], side_px: Sequence[float], overlaps: Sequence[Overlap]
) -> Answer:
    question = "enough tilt"
    known = [value for value in tilt_deg if value is not None and math.isfinite(value)]
    spread = max(known) - min(known) if known else 0.0
    of = "" if len(known) == len(tilt_deg) else f" between the {len(known)} images that record it"
    if spread > 0.5:
        steps = np.abs(np.diff(np.array(known)))
        if spread < MIN_TILT_DEG:
            return Answer(
                question=question, answer="no",
                reason=f"{spread:.1f} degrees in all{of}; {GOOD_TILT_DEG:.0f} or more are wanted",
            )  # fmt: skip
        if spread < GOOD_TILT_DEG:
            return Answer(
                question=question, answer="just",
                reason=f"{spread:.1f} degrees in all{of}: depths will depend on the tilts recorded "
                "and on a constant magnification",
            )  # fmt: skip
        if steps.max() > MAX_STEP_DEG:
            return Answer(
                question=question, answer="yes",
                reason=f"{spread:.1f} degrees{of}, but steps of up to {steps.max():.1f} are hard "
                f"to match; {MAX_STEP_DEG:.0f} or less are wanted",
            )  # fmt: skip
        return Answer(
            question=question, answer="yes",
            reason=f"{spread:.1f} degrees{of} in steps of up to {steps.max():.1f}",
        )  # fmt: skip
    usable = [overlap for overlap in overlaps if overlap.overlapping]
    if not usable:
        return Answer(question=question, answer="unknown", reason="no tilt is recorded")
    parallax = max(overlap.parallax_px for overlap in usable)
    side = float(np.median(np.array(side_px)))
    enough = parallax > MIN_PARALLAX_PART * side
    return Answer(
        question=question,
        answer="yes" if enough else "no",
        reason=f"no tilt is recorded; parallax of {parallax:.1f} px between frames "
        + ("shows depth" if enough else "is too little to show depth"),
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
