"""Regions before orientation and description: position, shape, strength."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from semsfm_colmap.types import Array, Float, Int


@dataclass(frozen=True, kw_only=True, eq=False)
class Regions:
    """K regions; positions in pixel indices (the first pixel's centre is (0, 0))."""

    xy: Float
    """(K, 2)"""
    scale_px: Float
    """(K,) characteristic scale: the deviation at which the Laplacian is extremal"""
    shape: Float
    """(K, 2, 2) determinant 1: the unit circle's image is the region's ellipse"""
    response: Float
    """(K,) strength, comparable within one detector"""
    detector_id: Int

    def __len__(self) -> int:
        return len(self.scale_px)

    def select(self, rows: Array) -> Regions:
        """Some of the regions, by mask or by index."""
        return Regions(
            xy=self.xy[rows],
            scale_px=self.scale_px[rows],
            shape=self.shape[rows],
            response=self.response[rows],
            detector_id=self.detector_id[rows],
        )


def circular_regions(xy: Float, scale_px: Float, response: Float, detector_id: int) -> Regions:
    """Regions with the identity as shape."""
    K = len(xy)
    return Regions(
        xy=xy.reshape(K, 2),
        scale_px=scale_px,
        shape=np.tile(np.eye(2), (K, 1, 1)),
        response=response,
        detector_id=np.full(K, detector_id, dtype=np.int64),
    )


def regions_from_frames(xy: Float, frame: Float, response: Float, detector_id: int) -> Regions:
    """Regions from the affine frames (K, 2, 2) of features; what they are turned by is left out.

    A frame A maps the unit circle to the ellipse, and so does its symmetric part in the polar
    decomposition A = S Q, which a region keeps.
    """
    scale = np.sqrt(np.abs(np.linalg.det(frame)))
    values, axes = np.linalg.eigh(frame @ frame.swapaxes(1, 2))
    symmetric = (axes * np.sqrt(np.maximum(values, 0.0))[:, None, :]) @ axes.swapaxes(1, 2)
    return Regions(
        xy=xy,
        scale_px=scale,
        shape=symmetric / np.maximum(scale, 1e-12)[:, None, None],
        response=response,
        detector_id=np.full(len(xy), detector_id, dtype=np.int64),
    )


def concatenate(parts: Sequence[Regions]) -> Regions:
    """One after the other."""
    return Regions(
        xy=np.concatenate([part.xy for part in parts]),
        scale_px=np.concatenate([part.scale_px for part in parts]),
        shape=np.concatenate([part.shape for part in parts]),
        response=np.concatenate([part.response for part in parts]),
        detector_id=np.concatenate([part.detector_id for part in parts]),
    )
