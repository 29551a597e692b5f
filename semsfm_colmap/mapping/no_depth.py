"""What to say of a part whose images show no depth."""

from __future__ import annotations

import numpy as np

from semsfm_colmap.factorization.degeneracy import RankDiagnosis
from semsfm_colmap.motion.prior import TiltPrior, known_tilts
from semsfm_colmap.motion.small_tilt import SMALL_ROTATION_DEG

EQUAL_TILTS_DEG = 0.1
"""Recorded tilts that differ by less are equal: stages are read to 0.1 deg at best."""


def without_depth(rank: RankDiagnosis, tilt: TiltPrior | None, names: list[str]) -> tuple[str, str]:
    """Status and sentence of a part whose images show no depth; recorded tilts may say why."""
    if tilt is not None and rank.status == "pure_translation":
        known = np.rad2deg(known_tilts(tilt, names)[0])
        known = known[np.isfinite(known)]
        if tilt.rotation_rad is not None:
            return rank.status, rank.message  # the stage rotated, too
        span = float(np.ptp(known)) if len(known) > 1 else np.nan
        if span < EQUAL_TILTS_DEG:
            return (
                "equal_tilts",
                "the images show no depth: they were all recorded at the same tilt of "
                f"{np.mean(known):.1f} deg ({tilt.source}); tilt the specimen between the images",
            )
        if span < SMALL_ROTATION_DEG:
            return (
                "tilt_too_small",
                f"the images show no depth: the recorded tilts ({tilt.source}) span {span:.1f} deg "
                "only, and what they would show is hidden in the noise; tilt further",
            )
    return rank.status, rank.message
