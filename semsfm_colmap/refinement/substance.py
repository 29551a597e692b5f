"""Whether a model is made of tracks or of noise.

RANSAC, filters and bundle adjustment always find something that fits: some dozens of tracks that
agree by chance on a motion nobody can check. Such a model is thin in everything: few observations
an image, angles or depths that are hardly larger than their error bars, few images of many. Each by
itself happens to honest series - a small tilt is uncertain, a smooth specimen has few tracks, a
turn falls into parts -; too few tracks together with one of the others is refused.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from semsfm_colmap.types import Float, Observations

MIN_IMAGE_OBSERVATIONS = 40.0
"""Median observations of an image: six times the unknowns of its camera."""
MAX_RELATIVE_SIGMA = 0.1
"""Standard deviation of the total rotation, as a share of it."""
MIN_DEPTH_SIGMAS = 3.0
"""Thickness of the cloud over the median standard deviation of its points."""
MIN_IMAGE_SHARE = 2.0 / 3.0
"""Of the images of a series that a model has."""


@dataclass(frozen=True, kw_only=True)
class Substance:
    """What a model rests on."""

    observations_per_image: float
    """median"""
    rotation_deg: float
    rotation_sigma_deg: float
    depth_sigmas: float
    """thickness of the cloud over the standard deviation of its points; nan: not known"""
    num_images: int
    num_given: int

    @property
    def doubts(self) -> list[str]:
        """What is wrong with it beside the few tracks."""
        found = []
        if not self.rotation_sigma_deg <= MAX_RELATIVE_SIGMA * self.rotation_deg:
            found.append(
                f"its total rotation is {self.rotation_deg:.1f} +- {self.rotation_sigma_deg:.1f} "
                "deg"
            )
        if self.depth_sigmas < MIN_DEPTH_SIGMAS:
            found.append(
                f"its points lie {self.depth_sigmas:.1f} of their own standard deviations deep"
            )
        if self.num_images < MIN_IMAGE_SHARE * self.num_given:
            found.append(f"it has {self.num_images} of {self.num_given} images")
        return found

    @property
    def is_noise(self) -> bool:
        """True for a model that nobody should measure in."""
        return self.observations_per_image < MIN_IMAGE_OBSERVATIONS and bool(self.doubts)

    @property
    def message(self) -> str:
        """One sentence with the evidence."""
        return (
            "the matches make no model that can be trusted: it rests on "
            f"{self.observations_per_image:.0f} observations an image, and "
            f"{', '.join(self.doubts)}; the specimen shows too little structure for these "
            "features, or the steps between the images are too large"
        )


def substance(
    points: Float,
    covariance: Float | None,
    observations: Observations,
    *,
    rotation_deg: float,
    rotation_sigma_deg: float,
    num_given: int,
) -> Substance:
    """What a model with its inlier observations rests on.

    Parameters
    ----------
    points, covariance : (N, 3), (N, 3, 3); None: no error bars can be given
    num_given : images of the series

    """
    count = np.bincount(observations.image_idx, minlength=observations.num_images)
    depth_sigmas = float("nan")
    if covariance is not None:
        centred = points - np.median(points, axis=0)
        _, _, Vt = np.linalg.svd(centred, full_matrices=False)
        thickness = float(np.std(centred @ Vt[2]))
        largest = np.linalg.eigvalsh(covariance)[:, -1]
        depth_sigmas = thickness / float(np.sqrt(max(np.median(largest), 1e-18)))
    return Substance(
        observations_per_image=float(np.median(count)),
        rotation_deg=rotation_deg,
        # without error bars the angles are as uncertain as can be
        rotation_sigma_deg=rotation_sigma_deg if covariance is not None else float("inf"),
        depth_sigmas=depth_sigmas,
        num_images=observations.num_images,
        num_given=num_given,
    )
