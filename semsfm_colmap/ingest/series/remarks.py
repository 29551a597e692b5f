"""What is pointed out about a series, in one sentence each; nothing here stops it."""

from __future__ import annotations

import math
from collections.abc import Sequence

from semsfm_colmap.io.wording import abbreviate
from semsfm_colmap.types import SemFrame

SAME_ANGLE_RAD = math.radians(0.1)


def frame_warnings(frames: Sequence[SemFrame]) -> list[str]:
    """What is odd about single images; what many share is said once."""
    names: dict[str, list[str]] = {}
    for frame in frames:
        for warning in frame.warnings:
            names.setdefault(warning, []).append(frame.name)
    return [f"{abbreviate(who)}: {warning}." for warning, who in names.items()]


def series_warnings(frames: Sequence[SemFrame]) -> list[str]:
    """What only the whole series shows: settings that changed, names that tools stumble over."""
    warnings = []
    corrected = [f.name for f in frames if f.metadata.tilt_corrected]
    if corrected and len(corrected) < len(frames):
        warnings.append(
            f"{abbreviate(corrected)}: tilt correction was on here but not in the other images."
        )
    rotations = {f.name: f.metadata.scan_rotation_rad for f in frames}
    known = [angle for angle in rotations.values() if angle is not None]
    if known and max(known) - min(known) > SAME_ANGLE_RAD:
        warnings.append(
            f"the scan rotation changes within the series (from {math.degrees(min(known)):.1f} to "
            f"{math.degrees(max(known)):.1f} degrees), which turns the images in their plane."
        )
    elif known and abs(known[0]) > SAME_ANGLE_RAD:
        warnings.append(
            f"the scan is rotated by {math.degrees(known[0]):.1f} degrees, and with it the tilt "
            "axis in the images."
        )
    spaced = [f.name for f in frames if " " in f.name]
    if spaced:
        warnings.append(
            f"{abbreviate(spaced)}: the name has spaces, which COLMAP's text format cannot hold; "
            "its binary format can."
        )
    return warnings
