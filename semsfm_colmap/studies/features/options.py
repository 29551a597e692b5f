"""Options of the comparison of detectors and descriptors."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

from annotated_types import Ge, MinLen

from semsfm_colmap.bounds import Angle, Checked, Count, CountOrNone, NotNegative, Positive, Seed
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
Names = Annotated[tuple[str, ...], MinLen(1)]


@dataclass(frozen=True, kw_only=True)
class StudyOptions(Checked):
    """What is compared, and on how many images."""

    detectors: Names = (
        *PAPER_DETECTORS,
        "harris-hessian-affine",
        *COLMAP_DETECTORS,
        UNION,
    )
    """Region detectors; unions are written with +. The first six are the paper's."""
    descriptors: Names = (
        *PAPER_DESCRIPTORS,
        "rootsift",
        "pca-sift",
        "moments",
        "shape-context",
    )
    """Descriptors; the first five are the paper's."""
    max_num_images: Annotated[int, Ge(2)] = 10
    """So many consecutive images are compared, from the first one on."""
    max_num_pairs: CountOrNone = 0
    """So many pairs are matched with each descriptor, the first ones; 0 = all. With SIFT it is
    always all."""
    step: Count = 1
    """Every so manieth image is taken: larger angles."""
    true_error_px: Positive = 2.0
    """A match is true when it lies within this of where the true surface says."""
    max_angle_deg: Angle = 40.0
    """Largest viewing angle at which repeatability is measured."""
    overlap_px: NotNegative = 1.5
    """Regions of two detectors are the same when their centres are closer than this."""
    overlap_scale_ratio: Annotated[float, Ge(1)] = 1.5
    """... and their scales differ by less than this factor."""
    exclusion_px: NotNegative = 2.0
    """Descriptors of one spot, closer than this, are no rivals in the ratio test."""
    seed: Seed = 0
    """Seed of the robust verification."""


@dataclass(frozen=True, kw_only=True)
class CompareOptions(Checked):
    """The options of all that takes part."""

    study: StudyOptions = field(default_factory=StudyOptions)
    detection: DetectorOptions = field(default_factory=DetectorOptions)
    description: DescriptorOptions = field(default_factory=DescriptorOptions)
    matching: MatchingOptions = field(default_factory=MatchingOptions)
