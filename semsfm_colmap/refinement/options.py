"""Options of the refinement stage."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from annotated_types import Ge

from semsfm_colmap.bounds import Angle, Checked, Count, NotNegative, Positive, Share, SomePositive

CameraModelName = Literal["orthographic", "scaled_orthographic", "affine"]


@dataclass(frozen=True, kw_only=True)
class RefinementOptions(Checked):
    """Triangulation, graduated filtering, bundle adjustment and depth reversal."""

    filter_thresholds_px: SomePositive = (8.0, 4.0, 2.0, 1.0)
    """Reprojection error allowed in each round of filtering; cameras are re-estimated after each
    (the paper's four rounds from 8 px to 1 px)."""
    min_threshold_sigmas: NotNegative = 3.0
    """No round filters below so many robust standard deviations of the residuals: where the noise
    is larger than the paper's, the last thresholds grow with it. One more round filters at exactly
    so many, for where the noise is smaller."""
    ransac_trials: Count = 15
    """Image pairs tried to triangulate a track."""
    min_track_length: Annotated[int, Ge(2)] = 3
    """Fewest inlier observations of a point."""
    min_image_observations: Count = 12
    """Fewest inlier observations of a registered image."""
    min_image_inlier_share: Share = 0.25
    """Smallest share of inliers among an image's observations of points, when it is registered and
    in the last round: an image of another size or specimen agrees with some points by chance."""
    min_triangulation_angle_deg: Angle = 1.0
    """Points whose rays all lie within this angle have no reliable depth and are left out."""
    camera_model: CameraModelName = "scaled_orthographic"
    """orthographic: one magnification; scaled: one an image; affine: also aspect and skew."""
    scale_sigma: Positive = 0.001
    """Prior: relative standard deviation of the magnification between images; SEMs have 0.0005 to
    0.003. With magnification estimated, the smallest that is tried."""
    magnification: Literal["estimated", "fixed"] = "estimated"
    """Width of that prior: estimated from the series, where its images clearly differ by more, or
    fixed at scale_sigma."""
    affine_sigma: Positive = 0.003
    """Prior: standard deviation of aspect - 1 and skew, with the affine camera model."""
    drift_sigma_px: NotNegative = 0.2
    """Prior of the scan drift, the displacement of the last row of a frame against the first:
    standard deviation, px. After a guided pass the drift is estimated and, where it is a finding,
    taken out of the observations; 0: neither is done."""
    scanned: Literal["auto", "yes", "no"] = "auto"
    """Whether the images were scanned row by row: auto asks the headers and the databar. Of others
    a drift is believed only where it leaves no doubt; no: none is sought."""
    drag_sigma_px: NotNegative = 1.0
    """Prior of the drag, by which shading pulls features down the slopes: standard deviation of its
    coefficient, px. After a guided pass it is estimated and taken out of the observations; 0:
    neither is done."""
    perspective: Literal["auto", "off"] = "auto"
    """Rays that are not parallel. auto: where they show clearly, observations are given as parallel
    projection would show them; off: they are only named."""
    loss: Literal["squared", "huber", "cauchy"] = "cauchy"
    """Loss of the bundle adjustments while wrong observations are still being filtered."""
    last_loss: Literal["squared", "huber", "cauchy"] = "squared"
    """Loss of the last bundle adjustment, over the observations that the filter has left: squares
    use all they know, and a bundle adjustment of COLMAP's then finds nothing to move."""
    loss_width: Positive = 2.5
    """Where a loss bends, in standard deviations of the residuals."""
    max_iterations: Count = 60
    """Most bundle adjustment steps of the last round."""
    depth_sign: Literal["auto", "as_is", "reversed"] = "auto"
    """Your word on the hand: auto decides by evidence; as_is and reversed refer to the model that
    auto writes first, which you have looked at. On the command line also --depth_sign."""
    receding_edge: Literal["unknown", "top", "bottom", "left", "right"] = "unknown"
    """Edge of the image that moves away from the viewer as the recorded tilt grows. With it a known
    tilt decides the hand; without it only its size is used."""
    min_depth_sign_confidence: Share = 0.95
    """Below this confidence the hand counts as ambiguous and both models are written."""
