"""When the measurement matrix has rank two: what the images then can and cannot say.

Under parallel projection a centred measurement matrix has rank three. Rank two means that no depth
shows, for one of two reasons that the affine maps between the images tell apart:

- the views do not differ by a tilt (pure shift, rotation in the image plane, a repeated image): the
  maps are similarities;
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
    status: str
    """"ok", "no_tilt" or "planar"."""

    @property
    def message(self) -> str:
        """One sentence, with what would settle it."""
        if self.status == "no_tilt":
            return (
                "the images show no depth: they differ by a shift or a rotation in the image plane "
                "only, or hardly at all; tilt the specimen between the images"
            )
        if self.status == "planar":
            return (
                "the images show no depth: the specimen is flat to within the noise, and the tilt "
                "of a plane is known only up to one parameter; give the tilt, or take images of a "
                "part with relief"
            )
        return "the images show depth"


def block_signal(block: Block) -> tuple[float, float]:
    """Signal to noise of the third singular value, and the largest stretch between two images."""
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
    return float(s[2] ** 2 / noise), largest_stretch(plane)


def largest_stretch(B: Float) -> float:
    """Largest ratio of singular values of the maps ``B_i B_0^-1``: (m, 2, 2) -> float."""
    if abs(np.linalg.det(B[0])) < 1e-12 * np.sum(B[0] ** 2):
        return float("inf")
    maps = B @ np.linalg.inv(B[0])
    singular = np.linalg.svd(maps, compute_uv=False)
    return float(np.max(singular[:, 0] / np.maximum(singular[:, 1], 1e-300)))


def diagnose_rank(blocks: list[Block]) -> RankDiagnosis:
    """Whether the blocks hold depth, and if not, why."""
    figures = np.array([block_signal(block) for block in blocks])
    signal, stretch = float(np.median(figures[:, 0])), float(np.max(figures[:, 1]))
    if np.max(figures[:, 0]) >= MIN_SIGNAL_TO_NOISE:
        status = "ok"
    else:
        status = "no_tilt" if stretch <= MAX_SIMILARITY_STRETCH else "planar"
    return RankDiagnosis(signal_to_noise=signal, stretch=stretch, status=status)
