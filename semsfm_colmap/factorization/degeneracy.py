"""When the measurement matrix has rank two: what the images then can and cannot say.

Under parallel projection a centred measurement matrix has rank three. Rank two means that no depth
shows, for one of two reasons that the affine maps between the images tell apart:

- the views do not differ by a tilt: the maps are similarities. Without a rotation the specimen was
  only shifted, as it is when all tilts are equal; else it was turned in the image plane;
- the views are tilted but the specimen is plane: the maps are affinities with unequal stretches.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from semsfm_colmap.factorization.blocks import Block
from semsfm_colmap.factorization.cbc import leading_basis, subspace_error
from semsfm_colmap.types import Float

MIN_SIGNAL_TO_NOISE = 4.0
"""Third singular value squared over the mean of the rest squared; noise alone gives 1 to 2."""
MIN_ROTATION_DEG = 0.5
"""Rotations in the image plane below this go with any shift of a stage."""
MAX_SIMILARITY_STRETCH = 1.002
"""Ratio of the stretches of a map up to which it is a similarity: a tilt of 3.6 degrees."""
TRIM = 3.0
"""Columns further from the plane than this many robust deviations are left out."""


@dataclass(frozen=True, kw_only=True)
class RankDiagnosis:
    """What the blocks say about depth."""

    signal_to_noise: float
    """median over the blocks"""
    stretch: float
    """largest ratio of the stretches of a map between two images"""
    rotation_deg: float
    """largest rotation in the image plane between two images"""
    status: str
    """"ok", "pure_translation", "in_plane_rotation" or "planar"."""

    @property
    def message(self) -> str:
        """One sentence, with what would settle it."""
        if self.status == "pure_translation":
            return (
                "the images show no depth: they differ by a shift at most, as when all are taken "
                "at one tilt, or by a tilt so small that the noise hides it; tilt the specimen by "
                "some degrees between the images"
            )
        if self.status == "in_plane_rotation":
            return (
                "the images show no depth: they differ by a rotation in the image plane of up to "
                f"{self.rotation_deg:.1f} deg and a shift only; tilt the specimen between the "
                "images, about an axis in the image"
            )
        if self.status == "planar":
            return (
                "the images show no depth: the specimen is flat to within the noise, and the tilt "
                "of a plane is known only up to one parameter; give the tilt, or take images of a "
                "part with relief"
            )
        return "the images show depth"


def block_signal(block: Block) -> tuple[float, float, float]:
    """Signal to noise of the third singular value; largest stretch and rotation of two images."""
    M = block.M
    mean, U, s = leading_basis(M)
    error = subspace_error(M, mean, U[:, :3])
    keep = error <= TRIM**2 * max(float(np.median(error)), 1e-18)
    if np.sum(keep) >= 6:
        M = M[:, keep]
        mean, U, s = leading_basis(M)
    rest = s[3:]
    noise = max(float(np.mean(rest**2)), 1e-8 * M.shape[1])
    plane = U[:, :2].reshape(-1, 2, 2) * s[:2]
    return float(s[2] ** 2 / noise), *stretch_and_rotation(plane)


def stretch_and_rotation(B: Float) -> tuple[float, float]:
    """Of the maps ``B_i B_0^-1``, (m, 2, 2): largest ratio of singular values, rotation in deg."""
    if abs(np.linalg.det(B[0])) < 1e-12 * np.sum(B[0] ** 2):
        return float("inf"), 0.0
    maps = B @ np.linalg.inv(B[0])
    singular = np.linalg.svd(maps, compute_uv=False)
    angle = np.arctan2(maps[:, 1, 0] - maps[:, 0, 1], maps[:, 0, 0] + maps[:, 1, 1])
    stretch = np.max(singular[:, 0] / np.maximum(singular[:, 1], 1e-300))
    return float(stretch), float(np.rad2deg(np.max(np.abs(angle))))


def diagnose_rank(blocks: list[Block]) -> RankDiagnosis:
    """Whether the blocks hold depth, and if not, why."""
    figures = np.array([block_signal(block) for block in blocks])
    signal, stretch = float(np.median(figures[:, 0])), float(np.max(figures[:, 1]))
    rotation_deg = float(np.max(figures[:, 2]))
    if np.max(figures[:, 0]) >= MIN_SIGNAL_TO_NOISE:
        status = "ok"
    else:
        status = "planar"
        if stretch <= MAX_SIMILARITY_STRETCH:
            turned = rotation_deg >= MIN_ROTATION_DEG
            status = "in_plane_rotation" if turned else "pure_translation"
    return RankDiagnosis(
        signal_to_noise=signal, stretch=stretch, rotation_deg=rotation_deg, status=status
    )
