"""Options of the detectors and descriptors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Interval

from semsfm_colmap.bounds import Checked, Count, CountOrNone, NotNegative, Positive, Share


@dataclass(frozen=True, kw_only=True)
class DetectorOptions(Checked):
    """Where regions are looked for and how many are kept.

    Thresholds are in units of the image's standard deviation, so that gain and offset of the
    detector do not matter.
    """

    max_num_features: CountOrNone = 8192
    """Most features of an image, spread evenly over it; 0 keeps all."""
    first_octave: Annotated[int, Interval(ge=-1, le=8)] = 0
    """-1 doubles the image first: slower, finer regions."""
    hessian_threshold: NotNegative = 0.015
    """Smallest scale-normalised determinant of the Hessian."""
    harris_threshold: NotNegative = 0.0005
    """Smallest scale-normalised Harris cornerness."""
    edge_threshold: NotNegative = 0.25
    """Smallest scale-normalised gradient of an edge point."""
    laplacian_threshold: NotNegative = 0.1
    """Smallest scale-normalised Laplacian at the characteristic scale."""
    max_scale_px: Positive = 40.0
    """Largest characteristic scale."""
    margin: NotNegative = 1.0
    """Smallest distance to the border and to masked pixels, in units of the feature's scale."""
    upright: bool = False
    """Fix the orientation instead of turning each region to its dominant gradient."""
    max_orientations: Count = 2
    """A region with several dominant gradients becomes up to so many features."""
    orientation_peak: Share = 0.8
    """A further orientation counts from this share of the strongest one on."""
    affine_iterations: CountOrNone = 12
    """Most steps of the second-moment adaptation."""
    affine_convergence: Positive = 0.05
    """The adaptation has converged when the region's gradients are isotropic to within this."""
    max_anisotropy: Annotated[float, Ge(1)] = 5.0
    """Regions whose ellipse is more elongated are dropped."""
    merge_distance: NotNegative = 0.4
    """Features of a union closer than this, in units of their scale, are near duplicates."""
    merge_scale_ratio: Annotated[float, Ge(1)] = 1.3
    """Near duplicates differ in scale by less than this factor."""
    grid_cells: Count = 16
    """Cells along the longer side of the grid that spreads the features."""


@dataclass(frozen=True, kw_only=True)
class DescriptorOptions(Checked):
    """How regions are described."""

    magnification: Positive = 6.0
    """Half width of the described patch in units of the feature's scale."""
    pca_dimensions: CountOrNone = 0
    """Dimensions kept by the descriptors with principal components; 0 takes their published
    number: 128 of GLOH, 36 of PCA-SIFT."""
