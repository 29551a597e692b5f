"""Linear maps learnt from data: principal components and whitening.

GLOH and PCA-SIFT keep the leading principal components of their raw vectors; the descriptors made
of few local quantities (steerable filters, differential invariants, moments) are compared by the
Mahalanobis distance, which is the Euclidean one after whitening. Maps fitted on rendered series are
shipped; `fit_projection` fits them on the images at hand.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from pathlib import Path

import numpy as np

from semsfm_colmap.errors import UsageError
from semsfm_colmap.types import Array

FILE_NAME = "projections.npz"
MIN_DEVIATION_SHARE = 1e-3
"""Directions with less deviation than this share of the largest are not blown up by whitening."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Projection:
    """``y = (x - mean) @ matrix``"""

    mean: Array
    """(D,) float32"""
    matrix: Array
    """(D, d) float32, leading directions first"""

    def apply(self, values: Array, dimensions: int = 0) -> Array:
        """Project (K, D) to (K, d), or to the leading `dimensions`."""
        if values.shape[1] != len(self.mean):
            raise UsageError(f"{values.shape=} but the projection takes (K, {len(self.mean)})")
        matrix = self.matrix[:, :dimensions] if dimensions else self.matrix
        return np.asarray((values - self.mean) @ matrix)


def fit_projection(values: Array, kind: str, dimensions: int = 0) -> Projection:
    """Principal components ("pca") or whitening ("whiten") of raw descriptors (K, D).

    Eigenvectors of the covariance matrix; signs are fixed by making the largest entry positive.
    """
    if kind not in ("pca", "whiten"):
        raise UsageError(f"{kind=} but expected 'pca' or 'whiten'")
    if len(values) < 2:
        raise UsageError(f"{values.shape=} but expected at least two descriptors to learn from")
    from scipy.linalg import eigh

    D = values.shape[1]
    kept = min(dimensions or D, D)
    mean = values.mean(axis=0, dtype=np.float64).astype(np.float32)
    centred = values - mean
    covariance = (centred.T @ centred).astype(np.float64) / (len(values) - 1)
    variance, vectors = eigh(covariance, subset_by_index=[D - kept, D - 1])
    variance, vectors = variance[::-1], vectors[:, ::-1]
    peak = vectors[np.abs(vectors).argmax(axis=0), np.arange(kept)]
    vectors = vectors * np.where(peak < 0.0, -1.0, 1.0)
    if kind == "whiten":
        deviation = np.sqrt(np.maximum(variance, 0.0))
        floor = max(MIN_DEVIATION_SHARE * float(deviation[0]), 1e-12)
        vectors = vectors / np.maximum(deviation, floor)
    return Projection(mean=mean, matrix=vectors.astype(np.float32))


@lru_cache(maxsize=16)
def shipped_projection(name: str) -> Projection:
    """The projection of a descriptor that comes with the package."""
    file = files("semsfm_colmap.features.descriptors") / FILE_NAME
    with file.open("rb") as stream, np.load(stream) as stored:
        return Projection(
            mean=stored[f"{name}_mean"].astype(np.float32),
            matrix=stored[f"{name}_matrix"].astype(np.float32),
        )


def write_projections(path: Path, projections: dict[str, Projection]) -> None:
    """Store projections in half precision: their entries are below 1, or need no more digits."""
    arrays: dict[str, Array] = {}
    for name, projection in projections.items():
        arrays[f"{name}_mean"] = projection.mean.astype(np.float32)
        large = projection.matrix.size > 4096
        arrays[f"{name}_matrix"] = projection.matrix.astype(np.float16 if large else np.float32)
    with path.open("wb") as stream:
        np.savez_compressed(stream, **arrays)  # type: ignore[arg-type]
