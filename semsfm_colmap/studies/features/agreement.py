"""Which regions two sets share: overlap of detectors (the paper's table 1), repeatability."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from semsfm_colmap.types import Bool, Float, Int


def shared_regions(
    xy1: Float, scale1: Float, xy2: Float, scale2: Float, *, max_px: float, scale_ratio: float
) -> Int:
    """Pairs (L, 2) of regions, each the other's nearest, near in position and in scale.

    Positions that are not finite take no part.
    """
    from scipy.spatial import cKDTree

    # log scale as a third coordinate that reaches max_px where the ratio is reached
    weight = max_px / np.log(scale_ratio)
    rows = np.flatnonzero(np.isfinite(xy1).all(axis=1))
    if not len(rows) or not len(xy2):
        return np.zeros((0, 2), dtype=np.int64)
    a = np.column_stack([xy1[rows], weight * np.log(scale1[rows])])
    b = np.column_stack([xy2, weight * np.log(scale2)])
    forth = np.asarray(cKDTree(b).query(a)[1])
    back = np.asarray(cKDTree(a).query(b)[1])
    mutual = back[forth] == np.arange(len(a))
    near = np.linalg.norm(a[:, :2] - b[forth, :2], axis=1) < max_px
    near &= np.abs(a[:, 2] - b[forth, 2]) < max_px
    keep = mutual & near
    return np.column_stack([rows[keep], forth[keep]]).astype(np.int64)


def overlap_share(num_shared: int, num1: int, num2: int) -> float:
    """Shared regions as a share of all of both, 0 to 1."""
    union = num1 + num2 - num_shared
    return num_shared / union if union else 0.0


@dataclass(frozen=True, kw_only=True)
class Repeatability:
    """How many regions of one image are found again in another, and where."""

    angle_deg: float
    num_visible: int
    """Regions whose place the other image shows"""
    num_repeated: int
    error_px: float
    """Median distance of a repeated region from its true place; nan without any"""

    @property
    def share(self) -> float:
        """Repeated regions among the visible ones."""
        return self.num_repeated / self.num_visible if self.num_visible else 0.0


def repeatability(
    predicted: Float,
    scale1: Float,
    xy2: Float,
    scale2: Float,
    *,
    usable: Bool,
    angle_deg: float,
    max_px: float,
    scale_ratio: float,
) -> Repeatability:
    """Repeatability of one image's regions in another.

    Parameters
    ----------
    predicted : (K1, 2) where the true surface says they are in the other image; nan where hidden
    usable : (K1,) False where the other image does not reach

    """
    visible = np.isfinite(predicted).all(axis=1) & usable
    rows = np.flatnonzero(visible)
    pairs = shared_regions(
        predicted[rows], scale1[rows], xy2, scale2, max_px=max_px, scale_ratio=scale_ratio
    )
    error = np.linalg.norm(predicted[rows][pairs[:, 0]] - xy2[pairs[:, 1]], axis=1)
    return Repeatability(
        angle_deg=angle_deg,
        num_visible=len(rows),
        num_repeated=len(pairs),
        error_px=float(np.median(error)) if len(pairs) else float("nan"),
    )
