"""Options of the surface stage. A length in px is one px of the images at their median scale."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, kw_only=True)
class SurfaceOptions:
    """Normals, dense stereo, fusion, meshing and texture."""

    # sparse cloud and normals
    min_track_length: int = 3
    """Points seen in fewer images are left out of the sparse cloud."""
    num_normal_neighbors: int = 24
    """Neighbours of the local plane fit that gives a point its normal."""
    num_outlier_neighbors: int = 16
    """Neighbours whose mean distance shows a stray point."""
    max_outlier_sigma: float = 2.5
    """A point is stray when that distance exceeds the cloud's mean by this many deviations."""

    # mesh
    method: Literal["ball_pivoting", "poisson"] = "ball_pivoting"
    """Ball pivoting keeps to the points and leaves open what was not seen; Poisson closes it."""
    ball_radius_factors: tuple[float, ...] = (1.0, 2.0, 4.0)
    """Ball radii in units of the median distance to the 8th neighbour."""
    thinning_factor: float = 0.5
    """Grid on which points are merged before meshing, in the same unit; 0 keeps all."""
    num_smoothing_iterations: int = 2
    """Passes that move points along their normals onto the local surface; 0 keeps the noise."""
    min_component_fraction: float = 0.01
    """Pieces with fewer faces than this share of the largest piece are dropped."""
    max_hole_edges: int = 40
    """Holes with at most this many boundary edges are filled; 0 leaves all open."""
    poisson_depth: int = 9
    """Octree depth of the Poisson surface: 8 coarse, 10 fine."""
    poisson_trim_quantile: float = 0.02
    """Share of the least supported Poisson vertices to cut away."""
