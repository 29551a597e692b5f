"""What has changed between two surfaces of one specimen, before and after wear, etching, growth.

The second is brought onto the first (`registration`); both become height maps on one grid. Changed
places are told from errors where the difference d, smoothed by a Gaussian filter of twice the T of
the reconstruction (`scale_limited`), is beyond 4 sigma on an area of T^2, its lateral resolution;
they are grown by twice T, since a change has tails that errors hide. Ragged rims, where a mesh ends
one way or the other, are left out as in `scale_limited`. A plane through d on the cells that are
left takes out what the changes have pulled the registration by:

    d = z_after - z_before - (a + b x + c y),    sigma^2 = f^2 (s_before^2 + s_after^2) + J C J^T

with the covariance C of a, b, c and, where the scale is free, of the scale. The error bars s are
against the true surface, most of them relief that both surfaces lack alike; f is the robust scale
of d / s on the unchanged part, where nothing but errors is seen, and at most 1.

Volumes are sums of d over cells of area A. Errors are alike within the area A_c = 2 alpha^2 T^2
that the filter of the reconstruction leaves correlated, those of the plane everywhere:

    u_V^2 = A A_c sum f^2 (s_before^2 + s_after^2) + A^2 (sum J) C (sum J)^T.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.ndimage import distance_transform_edt, label

from semsfm_colmap.errors import InputError
from semsfm_colmap.metrology.heights.filters import ALPHA, gaussian, support
from semsfm_colmap.metrology.heights.height_map import (
    HeightMap,
    check_cells,
    height_map_of_mesh,
    on_grid,
)
from semsfm_colmap.metrology.heights.levelling import scaled_places
from semsfm_colmap.metrology.heights.parameter_uncertainty import COVERAGE
from semsfm_colmap.metrology.heights.registration import Registration, register
from semsfm_colmap.metrology.heights.scale_limited import MIN_SUPPORT
from semsfm_colmap.types import Bool, Float, Int, TriangleMesh

SMOOTHING = 2.0
"""Of the difference, and growth of what has changed, in units of T."""
SMOOTHED = float(np.sqrt(1.0 + SMOOTHING**2))
"""White noise behind the filter of T alone has so many times the deviation of that behind both."""
CHANGED = 4.0
"""Standard deviations of the smoothed difference beyond which a place has changed."""
NUM_ROUNDS = 4
MIN_UNCHANGED_CELLS = 50


@dataclass(frozen=True, kw_only=True)
class Volume:
    """A change of volume, unit cubed, and its standard uncertainty."""

    value: float
    sigma: float
    area: float
    """that it is summed over, unit squared"""


@dataclass(frozen=True, kw_only=True, eq=False)
class SurfaceComparison:
    """The difference of two surfaces on a grid."""

    difference: HeightMap
    """after minus before along the normal of the mean plane, with its sigma; holes where either
    has one"""
    changed: Int
    """(rows, columns) -1 where surface was lost, 1 where it was gained, 0 elsewhere"""
    registration: Registration
    least_depth: float
    """Change of height over an area of T^2 that is told from errors, at the median error bar"""
    net: Volume
    """of all cells"""
    lost: Volume
    """of the places that have become lower; positive"""
    gained: Volume
    """of those that have become higher"""

    @property
    def significant_map(self) -> HeightMap:
        """The difference where it is beyond its 95 % bounds, 0 elsewhere."""
        d, sigma = self.difference.z, self.difference.sigma
        assert sigma is not None
        z = np.where(np.abs(d) > COVERAGE * sigma, d, 0.0)
        return self.difference.with_heights(np.where(self.difference.measured, z, np.nan))


def correlation_area(transfer_index: float) -> float:
    """Area within which errors are alike: 1 / (integral of the squared weights), 2 alpha^2 T^2."""
    return 2.0 * (ALPHA * transfer_index) ** 2


def compare_surfaces(
    before: TriangleMesh,
    after: TriangleMesh,
    unit: Literal["um", "px"],
    transfer_index: float,
    *,
    shown: TriangleMesh | None = None,
    with_scale: bool = False,
    spacing: float | None = None,
) -> SurfaceComparison:
    """Bring a surface onto another and tell what has changed.

    Parameters
    ----------
    before, after : with sigma, in one unit, each in a world of its own
    transfer_index : T of the reconstructions, the larger one of the two
    shown : the part of `before` that the maps are of; default: all of it
    with_scale : the scale of `after` is free

    Raises
    ------
    InputError
        A closed body, surfaces without an unchanged part, or hardly any cell that both have.

    """
    area = correlation_area(transfer_index)
    found = register(before, after, area, with_scale=with_scale)
    motion = found.fixed_from_moving
    assert after.vertex_sigma is not None
    placed = replace(
        after, vertices=motion.apply(after.vertices), vertex_sigma=motion.scale * after.vertex_sigma
    )
    base = height_map_of_mesh(shown or before, unit, spacing=spacing)
    assert base.origin is not None
    assert base.axes is not None
    other = on_grid(placed, unit, base.origin, base.axes, base.spacing, base.z.shape)
    if not (base.measured & other.measured).any():
        raise InputError("The two surfaces have no place in common: they cannot be compared.")
    assert base.sigma is not None
    assert other.sigma is not None
    own = min(found.error_scale, 1.0) * np.hypot(base.sigma, other.sigma)
    inside = support(base.measured & other.measured, base.spacing[::-1], SMOOTHING * transfer_index)
    z = np.where(inside >= MIN_SUPPORT, other.z - base.z, np.nan)
    raw = check_cells(replace(base, z=z, sigma=None, overhang=None))
    fitted = without_registration_error(raw, own, transfer_index)
    cell = base.spacing[0] * base.spacing[1]
    heights = base.z - np.nanmean(base.z)
    J = np.concatenate([plane_terms(raw), heights[..., None]], axis=-1)
    C = np.zeros((4, 4))
    C[:3, :3], C[3, 3] = fitted.covariance * max(area / cell, 1.0), found.scale_sigma**2
    sigma = np.sqrt(own**2 + np.einsum("rci,ij,rcj->rc", J, C, J))
    both = raw.measured
    z = fitted.z

    def volume(cells: Bool, sign: float = 1.0) -> Volume:
        together = J[cells].sum(axis=0)
        independent = max(area / cell, 1.0) * float(np.sum(own[cells] ** 2))
        variance = cell**2 * (independent + float(together @ C @ together))
        return Volume(
            value=cell * float(np.sum(sign * z[cells])),
            sigma=float(np.sqrt(variance)),
            area=cell * int(cells.sum()),
        )

    return SurfaceComparison(
        difference=replace(raw, z=z, sigma=np.where(both, sigma, np.nan)),
        changed=fitted.changed,
        registration=found,
        least_depth=CHANGED * float(np.median(own[both])) / SMOOTHED,
        net=volume(both),
        lost=volume(fitted.changed < 0, -1.0),
        gained=volume(fitted.changed > 0),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Fitted:
    """A difference without a plane, the plane's covariance for errors of each cell by itself."""

    z: Float
    changed: Int
    covariance: Float
    """(3, 3)"""


def without_registration_error(raw: HeightMap, own: Float, transfer_index: float) -> Fitted:
    """Take a plane through the unchanged cells out of a difference, and tell what has changed.

    Raises
    ------
    InputError
        Hardly anything is unchanged.

    """
    both, terms = raw.measured, plane_terms(raw)
    smoothing = SMOOTHING * transfer_index
    smooth_sigma = own / SMOOTHED
    dx, dy = raw.spacing
    changed = np.zeros(both.shape, dtype=np.int64)
    z, covariance = raw.z, np.eye(3)
    for _ in range(NUM_ROUNDS):
        use = both & (changed == 0)
        if use.sum() < MIN_UNCHANGED_CELLS:
            raise InputError(
                "Nearly all of the surface has changed: nothing tells how the two lie to one "
                "another; compare surfaces that have an unchanged part in common."
            )
        J = terms[use] / own[use, None]
        covariance = np.linalg.inv(J.T @ J)
        z = raw.z - terms @ (covariance @ (J.T @ (raw.z[use] / own[use])))
        smooth = gaussian(z, (dy, dx), smoothing) if smoothing > 2.0 * max(dx, dy) else z
        core = large_enough(np.abs(smooth) > CHANGED * smooth_sigma, transfer_index**2 / (dx * dy))
        if not core.any():
            changed = np.zeros(both.shape, dtype=np.int64)
            continue
        # around a core all belongs to it, whatever its sign: parts of noise would add up
        distance, (row, column) = distance_transform_edt(
            ~core, sampling=(dy, dx), return_indices=True
        )
        near = both & (distance <= smoothing)
        changed = np.where(near, np.sign(smooth[row, column]), 0.0).astype(np.int64)
    return Fitted(z=z, changed=changed, covariance=covariance)


def large_enough(cells: Bool, least: float) -> Bool:
    """The connected parts of some cells that have at least so many of them."""
    parts, _ = label(cells)
    counts = np.bincount(parts.ravel())
    return np.asarray(cells & (counts[parts] >= least))


def plane_terms(height_map: HeightMap) -> Float:
    """(rows, columns, 3) of 1, x, y."""
    x, y = scaled_places(height_map)
    return np.stack([np.ones_like(x), x, y], axis=-1)
