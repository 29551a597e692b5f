"""Descriptors of normalised patches: each a function (K, P, P) -> (K, D), all patches at once."""

from semsfm_colmap.features.descriptors.filters import differential, steerable
from semsfm_colmap.features.descriptors.histograms import gloh, rootsift, shape_context, sift
from semsfm_colmap.features.descriptors.moments import moments
from semsfm_colmap.features.descriptors.pixels import ncc, pca_sift

__all__ = [
    "differential",
    "gloh",
    "moments",
    "ncc",
    "pca_sift",
    "rootsift",
    "shape_context",
    "sift",
    "steerable",
]
