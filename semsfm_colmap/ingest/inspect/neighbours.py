"""Frames that do not fit their neighbours: sheared, moved, out of order, or of something else."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from semsfm_colmap.geometry.losses import MAD_TO_SIGMA
from semsfm_colmap.ingest.inspect.overlap import Overlap, ReducedFeatures, find_overlap
from semsfm_colmap.types import Float

SHEAR = 8e-3
"""Shear of a frame against both neighbours: drift of 8 px over 1000 rows."""
MIN_OTHER_STEPS = 3
SHEAR_SPREAD = 3.0
"""Steps of shear below so many standard deviations of the others' are noise of the fit."""
ALONE = 2.0
"""A frame at the end is sheared where its step jumps by so many times the largest other jump."""
MOVED_PART = 0.3
"""Shift between frames, relative to the image side, above which the overlap gets small."""
FARTHER = 1.3
"""Parallax against a neighbour, relative to the median of all steps, from which the angle between
them is no usual one."""
CLOSER = 0.8
"""Parallax between the neighbours of a frame, relative to the smaller one against it, below which
it is out of order: in order, theirs is about the sum of the two."""


def drifted(
    names: Sequence[str], side_px: Sequence[float], overlaps: Sequence[Overlap]
) -> dict[str, str]:
    """Frames that drifted while they were scanned, or between frames.

    Drift within a frame shears it: x changes linearly with the row, while the rows, along which the
    beam is fast, stay straight; so a turn of the frame is where the rows went. The shear between
    consecutive frames is the difference of theirs, plus what the rotation of the specimen does,
    which changes slowly, and what parallax does to the fit, which is noise. A frame that has
    drifted therefore has a step of shear before it and the opposite one after it, both beyond the
    noise of the others. A frame that is seen under quite another angle is sheared by that, too:
    where there is more parallax than usual, nothing is said.
    """
    notes: dict[str, str] = {}
    parallax = np.array([o.parallax_px if o.overlapping else np.nan for o in overlaps])
    usual = np.nanmedian(parallax) if np.isfinite(parallax).any() else np.nan
    steps = np.array(
        [_shear(o.linear) if o.overlapping and o.linear is not None else np.nan for o in overlaps]
    )
    for i, shear in enumerate(_sticking_out(steps)):
        beside = parallax[max(i - 1, 0) : i + 1]
        if shear and not np.nanmax(beside) > FARTHER * usual:
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
    and the last frame have one neighbour only, and no opposite step to bear witness: their step
    must differ from the next one, which does not stand out, far more than any two others do.
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
        limit = max(SHEAR, SHEAR_SPREAD * MAD_TO_SIGMA * float(np.median(np.abs(others - level))))
        before, after = (float(v) - level for v in (steps[max(i - 1, 0)], steps[min(i, count - 1)]))
        if 0 < i < count:
            if before * after < 0 and min(abs(before), abs(after)) > limit:
                out[i] = (before - after) / 2
            continue
        end, beside_it = (0, 1) if i == 0 else (-1, -2)
        jump = float(steps[end] - steps[beside_it])
        others_jump = np.abs(np.diff(steps[1:] if i == 0 else steps[:-1]))
        usual = float(np.nanmax(others_jump, initial=0.0))
        if abs(jump) > max(limit, ALONE * usual) and abs(steps[beside_it] - level) <= limit:
            out[i] = -after if i == 0 else before
    return out


def misplaced(
    names: Sequence[str], features: Sequence[ReducedFeatures], overlaps: Sequence[Overlap]
) -> list[str]:
    """Frames whose neighbours are closer to one another than to them: out of order."""
    parallax = np.array([o.parallax_px if o.overlapping else np.nan for o in overlaps])
    if np.isfinite(parallax).sum() < MIN_OTHER_STEPS:
        return []
    usual = float(np.nanmedian(parallax))
    found = []
    for i in range(1, len(overlaps)):
        own = float(min(parallax[i - 1], parallax[i]))
        if not own > FARTHER * usual:
            continue
        across = find_overlap(features[i - 1], features[i + 1])
        if across.overlapping and across.parallax_px < CLOSER * own:
            found.append(names[i])
    return found


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
