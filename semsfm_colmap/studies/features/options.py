"""Options of the comparison of detectors and descriptors."""

from __future__ import annotations

from dataclasses import dataclass, field

from semsfm_colmap.features.options import DescriptorOptions, DetectorOptions
from semsfm_colmap.matching.options import MatchingOptions

PAPER_DETECTORS = (
    "harris-affine",
    "harris-laplace",
    "hessian-affine",
    "hessian-laplace",
    "harris-hessian-laplace",
    "edge-laplace",
)
PAPER_DESCRIPTORS = ("sift", "gloh", "cc", "steerable", "differential")
COLMAP_DETECTORS = ("colmap-sift", "colmap-sift-affine", "colmap-sift-pooled")
"""COLMAP's own detectors; "sift" then stands for its own descriptor too."""
UNION = "harris-hessian-laplace+colmap-sift"


@dataclass(frozen=True, kw_only=True)
class StudyOptions:
    """What is compared, and on how many images."""

    detectors: tuple[str, ...] = (
        *PAPER_DETECTORS,
        "harris-hessian-affine",
        *COLMAP_DETECTORS,
        UNION,
    )
    """Region detectors; unions are written with +. The first six are the paper's."""
    descriptors: tuple[str, ...] = (
        *PAPER_DESCRIPTORS,
        "rootsift",
        "pca-sift",
        "moments",
        "shape-context",
    )
    """Descriptors; the first five are the paper's."""
    max_num_images: int = 10
    """So many consecutive images are compared, from the first one on."""
    max_num_pairs: int = 0
    """So many pairs are matched with each descriptor, the first ones; 0 = all. With SIFT it is
    always all."""
    step: int = 1
    """Every so manieth image is taken: larger angles."""
    true_error_px: float = 2.0
    """A match is true when it lies within this of where the true surface says."""
    max_angle_deg: float = 40.0
    """Largest viewing angle at which repeatability is measured."""
    overlap_px: float = 1.5
    """Regions of two detectors are the same when their centres are closer than this."""
    overlap_scale_ratio: float = 1.5
    """... and their scales differ by less than this factor."""
    exclusion_px: float = 2.0
    """Descriptors of one spot, closer than this, are no rivals in the ratio test."""
    seed: int = 0
    """Seed of the robust verification."""


@dataclass(frozen=True, kw_only=True)
class CompareOptions:
    """The options of all that takes part."""

    study: StudyOptions = field(default_factory=StudyOptions)
    detection: DetectorOptions = field(default_factory=DetectorOptions)
    description: DescriptorOptions = field(default_factory=DescriptorOptions)
    matching: MatchingOptions = field(default_factory=MatchingOptions)
