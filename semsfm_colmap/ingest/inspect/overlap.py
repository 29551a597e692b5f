"""Whether consecutive frames show the same thing, and how it moves between them.

SIFT on reduced images, mutual nearest neighbours with the ratio test, and an affine map by RANSAC
with a wide threshold: enough to tell overlap from its absence, since unrelated images agree on
hardly more matches than the three that define the map. The map's residual is parallax, without
which there is no depth to be had; its stretch and shear show a change of magnification and drift
within a frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from semsfm_colmap.types import Array, Float

WORK_SIDE_PX = 512
MAX_FEATURES = 800
RATIO = 0.8
"""Lowe's ratio test."""
THRESHOLD_PX = 8.0
"""Residual that parallax may cause at the working size."""
MIN_AGREEING = 12
"""Unrelated images were seen to agree on up to 5 matches."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ReducedFeatures:
    """Keypoints in px of the original image, and descriptors."""

    xy: Float
    descriptors: Array
    scale: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Overlap:
    """How two images relate: how many matches agree, the affine map and its residual."""

    num_agreeing: int
    linear: Float | None
    """(2, 2) from the first to the second image"""
    shift_px: Float | None
    parallax_px: float
    """RMS residual of the agreeing matches, in px of the original image."""

    @property
    def overlapping(self) -> bool:
        """Whether the two images show the same thing."""
        return self.num_agreeing >= MIN_AGREEING

    @property
    def magnification(self) -> float:
        """Change of magnification: the part of the stretch that both directions share."""
        if self.linear is None or not self.overlapping:
            return 1.0
        low, high = sorted(np.log(np.linalg.svd(self.linear, compute_uv=False)))
        if low > 0:
            return float(np.exp(low))
        return float(np.exp(high)) if high < 0 else 1.0


def reduced_features(grey: Array) -> ReducedFeatures:
    """SIFT keypoints of a reduced image."""
    import cv2

    scale = min(1.0, WORK_SIDE_PX / max(grey.shape))
    size = (max(8, round(grey.shape[1] * scale)), max(8, round(grey.shape[0] * scale)))
    small = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
    keypoints, descriptors = cv2.SIFT.create(nfeatures=MAX_FEATURES).detectAndCompute(small, None)
    if descriptors is None or len(keypoints) < 2:
        return ReducedFeatures(
            xy=np.zeros((0, 2)), descriptors=np.zeros((0, 128), np.float32), scale=scale
        )
    xy = np.array([keypoint.pt for keypoint in keypoints]) / scale
    return ReducedFeatures(xy=xy, descriptors=np.asarray(descriptors), scale=scale)


def find_overlap(first: ReducedFeatures, second: ReducedFeatures) -> Overlap:
    """Match two images and fit an affine map."""
    import cv2

    nothing = Overlap(num_agreeing=0, linear=None, shift_px=None, parallax_px=0.0)
    if len(first.xy) < 6 or len(second.xy) < 6:
        return nothing
    pairs = _matches(first.descriptors, second.descriptors)
    if len(pairs) < 6:
        return nothing
    x, y = first.xy[pairs[:, 0]], second.xy[pairs[:, 1]]
    cv2.setRNGSeed(0)
    matrix, inlier = cv2.estimateAffine2D(
        x, y, method=cv2.RANSAC, ransacReprojThreshold=THRESHOLD_PX / first.scale
    )
    if matrix is None or not np.isfinite(matrix).all():
        return nothing
    inside = np.asarray(inlier).ravel() > 0
    residual = y[inside] - x[inside] @ matrix[:, :2].T - matrix[:, 2]
    centre = first.xy.mean(axis=0)
    return Overlap(
        num_agreeing=int(inside.sum()),
        linear=np.asarray(matrix[:, :2]),
        shift_px=np.asarray(matrix[:, :2] @ centre + matrix[:, 2] - centre),
        parallax_px=float(np.sqrt((residual**2).sum(axis=1).mean())),
    )


def chain(features: Sequence[ReducedFeatures]) -> list[Overlap]:
    """Overlap of each frame with the next."""
    return [find_overlap(a, b) for a, b in pairwise(features)]


def _matches(first: Array, second: Array) -> Array:
    """(L, 2) indices of mutual nearest neighbours that pass the ratio test."""
    a, b = first.astype(np.float32), second.astype(np.float32)
    squared = (a * a).sum(axis=1)[:, None] + (b * b).sum(axis=1)[None] - 2 * (a @ b.T)
    nearest = squared.argmin(axis=1)
    back = squared.argmin(axis=0)
    two = np.partition(squared, 1, axis=1)[:, :2]
    good = (two[:, 0] < RATIO**2 * two[:, 1]) & (back[nearest] == np.arange(len(a)))
    rows = np.flatnonzero(good)
    return np.column_stack([rows, nearest[rows]])
