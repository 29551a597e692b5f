"""What is known about the tilt before anything is computed: a prior, never a command.

A stage, a table or a nominal step give an angle per image. Stages have an unknown zero and some
backlash, so only differences count, each with a standard deviation; whether the numbers are right
at all is checked against the reconstruction (`motion.check`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from semsfm_colmap.types import Float

MIN_RANGE_DEG = 0.5
"""Tilts that vary less say that the specimen was not turned by the stage."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TiltPrior:
    """Known tilts: only their differences count; nan where nothing is known."""

    image_names: tuple[str, ...]
    angle_rad: Float
    """(M,) about one axis common to all images"""
    sigma_rad: Float
    """(M,)"""
    axis_image_rad: float | None
    """Direction of the axis in the images, from x toward y; None = to be estimated."""
    source: str
    rotation_rad: Float | None = None
    """(M,) of the stage about its normal (`motion.stage`), nan where unknown; None where it does
    not vary"""

    @property
    def range_rad(self) -> float:
        """Largest minus smallest known angle."""
        return float(np.nanmax(self.angle_rad) - np.nanmin(self.angle_rad))


def known_tilts(prior: TiltPrior, names: Sequence[str]) -> tuple[Float, Float]:
    """Known angles and their sigmas of some images, nan where nothing is known."""
    number = {name: k for k, name in enumerate(prior.image_names)}
    rows = np.array([number.get(name, -1) for name in names], dtype=np.int64)
    return np.append(prior.angle_rad, np.nan)[rows], np.append(prior.sigma_rad, np.nan)[rows]
