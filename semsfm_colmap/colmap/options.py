"""Options of the COLMAP side: SIFT, the model that is written, a changed model taken over."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Interval

from semsfm_colmap.bounds import Checked, Count, NotNegative, Positive, Share


@dataclass(frozen=True, kw_only=True)
class SiftOptions(Checked):
    """SIFT on the CPU; adapted shapes and pooling are COLMAP's only."""

    max_num_features: Count = 8192
    """Most keypoints of an image."""
    first_octave: Annotated[int, Interval(ge=-1, le=8)] = -1
    """-1 doubles the image first: more and finer keypoints."""
    peak_threshold: NotNegative = 0.02 / 3
    """Contrast below which a keypoint is dropped."""
    edge_threshold: Positive = 10.0
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
class ExportOptions(Checked):
    """The COLMAP model."""

    max_deviation_px: Positive = 0.02
    """Largest allowed distance between COLMAP's long-focal pinhole and the parallel projection; a
    bundle adjustment of COLMAP's turns the cameras in proportion to it."""


@dataclass(frozen=True, kw_only=True)
class AdoptionOptions(Checked):
    """How far a changed model may be from the old one."""

    max_rotation_deg: NotNegative = 0.5
    """No camera may turn further, once the worlds are aligned."""
    max_magnification_change: NotNegative = 0.005
    """Nor change its magnification, relative to the others, by more than this share."""
    max_focal_change: NotNegative = 1e-6
    """Relative change of the focal length that still counts as fixed."""
    max_error_increase: NotNegative = 0.05
    """The mean error of the observations that both models have may grow by this share."""
    max_lost_observations: Share = 0.5
    """Share of the old observations that may be gone."""
    max_deviation_px: Positive = 0.1
    """The changed cameras must be parallel to this."""
