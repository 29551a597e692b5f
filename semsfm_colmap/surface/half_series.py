"""Two surfaces from disjoint halves of the frames, and how far apart they are.

As cryo-electron microscopy does with half-maps: the depth maps of the odd frames, matched against
odd frames only, give one surface, those of the even frames another. They share the cameras, and
what windows and shading do to every frame alike, but no pixel: their difference along the normals
shows what is noise. With d the distance from a point of the one to the other and sigma the standard
deviations of both (`fusion/error_bars.py`), the ratio

    robust deviation of  d / sqrt(sigma_odd^2 + sigma_even^2)

is 1 where all errors are independent; what both halves err in alike keeps it below. Above 1, the
error bars are too small. Each half has every second view, at steps twice as wide: it errs more than
the whole.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from semsfm_colmap.geometry.losses import MAD_TO_SIGMA
from semsfm_colmap.geometry.subset import take_subset
from semsfm_colmap.records import SurfaceHalves
from semsfm_colmap.surface.options import SurfaceOptions
from semsfm_colmap.types import Bool, Float, Int, PointCloud, Reconstruction

NUM_NEAREST = 9
REACH = 1.5
"""Points of the other half within so many spacings of the fused cloud count."""
MIN_AGREEMENT = 0.5
"""Least cosine between two normals: the other side of something thin is not asked."""
MAX_GAP = 4.0
"""Surfaces farther apart along the normal, in spacings, are different ones."""


@dataclass(frozen=True, kw_only=True, eq=False)
class HalfDifference:
    """The odd half's points, and how far outside of them the even half's surface lies."""

    cloud: PointCloud
    """of the odd frames"""
    difference: Float
    """(N,) along the normal in world units, nan where the other half has no surface"""
    sigma: Float
    """(N,) of that difference, were all errors independent"""

    @property
    def compared(self) -> Bool:
        """(N,) where both halves have a surface."""
        return np.asarray(np.isfinite(self.difference))

    @property
    def share(self) -> float:
        """Part of the points that the other half has too."""
        return float(self.compared.mean()) if len(self.difference) else 0.0

    @property
    def rms(self) -> float:
        """Root mean square of the difference, world units."""
        return float(np.sqrt(np.mean(self.difference[self.compared] ** 2)))

    @property
    def robust(self) -> float:
        """The same from the median, which strays do not move."""
        return float(MAD_TO_SIGMA * np.median(np.abs(self.difference[self.compared])))

    @property
    def expected(self) -> float:
        """Median of its standard deviation, were all errors independent, world units."""
        return float(np.median(self.sigma[self.compared]))

    @property
    def ratio(self) -> float:
        """The module's ratio."""
        pull = self.difference[self.compared] / self.sigma[self.compared]
        return float(MAD_TO_SIGMA * np.median(np.abs(pull)))


def figures(found: HalfDifference, num_even: int, px: float) -> SurfaceHalves | None:
    """The numbers for the report; None where the halves share no surface.

    Parameters
    ----------
    num_even : points of the even frames
    px : world units per px of the images

    """
    if not found.compared.any():
        return None
    return SurfaceHalves(
        num_points=(len(found.difference), num_even),
        shared=found.share,
        rms_px=found.rms / px,
        robust_rms_px=found.robust / px,
        median_px=float(np.median(found.difference[found.compared])) / px,
        expected_px=found.expected / px,
        ratio=found.ratio,
    )


def halves(num_images: int) -> tuple[Int, Int]:
    """The first, third, ... images, and the second, fourth, ..."""
    numbers = np.arange(num_images)
    return numbers[::2], numbers[1::2]


def fused_spacing(reconstruction: Reconstruction, options: SurfaceOptions) -> float:
    """Distance between fused points, world units: `options.spacing_px` of the depth maps."""
    longer = float(np.max(reconstruction.image_size_px))
    reduced = max(1.0, longer / options.max_depth_map_size_px)
    return options.spacing_px * reduced * image_px(reconstruction)


def image_px(reconstruction: Reconstruction) -> float:
    """World units per px of the images, at their median scale."""
    return 1.0 / float(np.median(reconstruction.cameras.scale_px_per_unit))


def part_of(reconstruction: Reconstruction, images: Int) -> Reconstruction:
    """The same model with some of its images, and the points that these see."""
    subset = take_subset(reconstruction.observations, images=images, mask=reconstruction.inlier)
    covariance, color = reconstruction.point_covariance, reconstruction.point_color
    drift = reconstruction.drift_px
    return Reconstruction(
        image_names=tuple(reconstruction.image_names[i] for i in images),
        image_size_px=reconstruction.image_size_px[images],
        cameras=reconstruction.cameras.select(images),
        points=reconstruction.points[subset.tracks],
        observations=subset.observations,
        inlier=np.ones(len(subset.observations), dtype=bool),
        point_color=None if color is None else color[subset.tracks],
        point_covariance=None if covariance is None else covariance[subset.tracks],
        world_unit=reconstruction.world_unit,
        pixel_size_um=reconstruction.pixel_size_um,
        pixel_size_source=reconstruction.pixel_size_source,
        camera_model=reconstruction.camera_model,
        depth_sign=reconstruction.depth_sign,
        gauge=reconstruction.gauge,
        drift_px=None if drift is None else drift[images],
        drag_px=reconstruction.drag_px,
        relief_px=reconstruction.relief_px,
    )


def half_difference(odd: PointCloud, even: PointCloud, spacing: float) -> HalfDifference:
    """How far outside of the points of one cloud the surface of another lies.

    The other's surface at a point is the mean of the planes of its nearest points, weighted by
    ``exp(-r^2 / 2 spacing^2)`` of the distance r across the normal.

    Parameters
    ----------
    odd, even : with normals and sigma
    spacing : between the points of either, world units

    """
    from scipy.spatial import cKDTree

    assert odd.normals is not None
    assert even.normals is not None
    assert odd.sigma is not None
    assert even.sigma is not None
    num = min(NUM_NEAREST, len(even.points))
    difference = np.full(len(odd.points), np.nan)
    expected = np.full(len(odd.points), np.nan)
    if num == 0 or len(odd.points) == 0:
        return HalfDifference(cloud=odd, difference=difference, sigma=expected)
    _, idx = cKDTree(even.points).query(odd.points, k=num, workers=-1)
    idx = idx.reshape(-1, num)
    gap = even.points[idx] - odd.points[:, None]
    along = np.einsum("nki,ni->nk", gap, odd.normals)
    across = np.linalg.norm(gap - along[:, :, None] * odd.normals[:, None], axis=2)
    agreement = np.einsum("nki,ni->nk", even.normals[idx], odd.normals)
    counts = (across < REACH * spacing) & (agreement > MIN_AGREEMENT)
    counts &= np.abs(along) < MAX_GAP * spacing
    # the plane of the other's point, where the normal of this one meets it
    plane = np.einsum("nki,nki->nk", gap, even.normals[idx]) / np.where(counts, agreement, 1.0)
    weight = np.where(counts, np.exp(-0.5 * (across / spacing) ** 2), 0.0)
    total = weight.sum(axis=1)
    met = total > 0.0
    difference[met] = (weight * plane).sum(axis=1)[met] / total[met]
    other = (weight * even.sigma[idx] ** 2).sum(axis=1)[met] / total[met]
    expected[met] = np.sqrt(odd.sigma[met] ** 2 + other)
    return HalfDifference(cloud=odd, difference=difference, sigma=expected)
