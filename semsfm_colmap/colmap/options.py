"""Options of the COLMAP side: feature extraction and matching through pycolmap, model export."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class SiftOptions:
    """COLMAP's SIFT on the CPU."""

    max_num_features: int = 8192
    """Most keypoints of an image."""
    first_octave: int = -1
    """-1 doubles the image first: more and finer keypoints."""
    peak_threshold: float = 0.02 / 3
    """Contrast below which a keypoint is dropped."""
    edge_threshold: float = 10.0
    """Ratio of curvatures above which a keypoint counts as an edge."""
    estimate_affine_shape: bool = False
    """Adapt each keypoint to an ellipse."""
    domain_size_pooling: bool = False
    """Pool descriptors over several domain sizes: slower, more matches."""
    upright: bool | None = None
    """Keypoints keep the image's orientation, which serves specimens that do not turn in the image
    plane, instead of turning to their dominant gradient; by default what finds more matches in a
    few pairs."""


@dataclass(frozen=True, kw_only=True)
class ExportOptions:
    """The COLMAP model."""

    max_deviation_px: float = 0.02
    """Largest allowed distance between COLMAP's long-focal pinhole and the parallel projection; a
    bundle adjustment of COLMAP's turns the cameras in proportion to it."""
