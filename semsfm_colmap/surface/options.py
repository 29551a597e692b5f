"""Options of the surface stage. A length in px is one px of the images at their median scale."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from annotated_types import Ge, Interval

from semsfm_colmap.bounds import (
    Angle,
    Checked,
    Correlation,
    Count,
    CountOrNone,
    NotNegative,
    Positive,
    Share,
    SomePositive,
)


@dataclass(frozen=True, kw_only=True)
class SurfaceOptions(Checked):
    """Normals, dense stereo, fusion, meshing and texture."""

    # sparse cloud and normals
    min_track_length: Annotated[int, Ge(2)] = 3
    """Points seen in fewer images are left out of the sparse cloud."""
    num_normal_neighbors: Annotated[int, Ge(3)] = 24
    """Neighbours of the local plane fit that gives a point its normal."""
    num_outlier_neighbors: Count = 16
    """Neighbours whose mean distance shows a stray point."""
    max_outlier_sigma: Positive = 2.5
    """A point is stray when that distance exceeds the cloud's mean by this many deviations."""

    # dense stereo
    max_depth_map_size_px: Annotated[int, Ge(16)] = 1024
    """Longer side of a depth map; larger images are reduced to it."""
    max_num_depth_maps: Count = 48
    """Images that get a depth map; of longer series as many, spread over the directions."""
    min_reference_angle_deg: Angle = 3.0
    """Of images seen at smaller angles to one another only some get a depth map; all are matched
    against."""
    num_neighbors: Count = 6
    """Images that each depth map is matched against."""
    min_baseline_deg: Angle = 2.0
    """Images seen at a smaller angle to the reference give no depth."""
    max_baseline_deg: Angle = 16.0
    """Images seen at a larger angle look too different."""
    depth_margin: NotNegative = 0.5
    """The sweep reaches this share of the sparse points' depth range beyond them: spines and rims
    have few points of their own."""
    sweep_step_px: Positive = 1.5
    """Parallax between two surfaces of a sweep, in px."""
    sweep_window_radius_px: Count = 2
    """The sweeps correlate windows of 2 r + 1 px."""
    max_relief_px: Positive = 15.0
    """Depth that details may stand out from the half-size surface, in px of the depth map."""
    window_radius_px: Count = 3
    """The refinement correlates windows of 2 r + 1 px."""
    window_grey_share: Positive = 0.27
    """Pixels that differ from the window's centre by this share of the contrast do not count."""
    visibility_spread: NotNegative = 0.4
    """A neighbour that correlates this much worse than the best one does not count."""
    slope_radius_px: Count = 3
    """Local planes are fitted to depths within this distance."""
    num_refinements: CountOrNone = 2
    """Gauss-Newton steps of each depth."""
    smoothness: NotNegative = 0.1
    """Pull of a depth to its local plane, as an inverse variance in px: 0.1 means 3 px."""
    min_correlation: Correlation = 0.2
    """Depths whose windows correlate less are dropped."""
    min_speck_px: CountOrNone = 60
    """Connected patches of fewer depth pixels are dropped."""

    # fusion
    num_fusion_neighbors: Count = 10
    """Depth maps that each one is compared with."""
    max_fusion_angle_deg: Angle = 45.0
    """Depth maps seen at a larger angle are not compared."""
    consistency_px: Positive = 2.0
    """Surfaces of two depth maps agree within this distance, in px of the depth maps."""
    contradiction_px: Positive = 6.0
    """A point this far in front of another map's surface is contradicted by it."""
    min_consistent_maps: CountOrNone = 1
    """Other depth maps that must agree with a point."""
    min_lone_confidence: NotNegative = 0.5
    """A depth that no other map agrees with or contradicts counts when it correlates this much."""
    max_fused_outlier_sigma: Positive = 5.0
    """As `max_outlier_sigma`, of the fused points, which depth maps have agreed on already."""
    spacing_px: Positive = 2.0
    """Distance between the points of the fused cloud, in px of the depth maps."""

    half_series: bool = False
    """Also make the surfaces of the odd and of the even frames, each from its own frames alone, and
    compare them: dense/half_series.ply. Takes the time of the depth maps once more."""

    # mesh
    method: Literal["ball-pivoting", "poisson", "tsdf", "delaunay-2.5d", "convex-hull"] = (
        "ball-pivoting"
    )
    """ball-pivoting keeps to the points and leaves open what was not seen; poisson fits a smooth
    surface; tsdf joins depth maps on a grid; delaunay-2.5d is a height field over the mean viewing
    direction; convex-hull the smallest convex body."""
    watertight: bool = False
    """Close every hole, however large: a body that can be printed, with surface that nobody saw."""
    ball_radius_factors: SomePositive = (1.0, 2.0, 4.0)
    """Ball radii in units of the median distance to the 8th neighbour."""
    thinning_factor: NotNegative = 0.6
    """Grid on which points are merged before meshing, in the same unit; 0 keeps all."""
    num_smoothing_iterations: CountOrNone = 1
    """Passes that move points along their normals onto the local surface; 0 keeps the noise."""
    min_component_fraction: Share = 0.005
    """Pieces with fewer faces than this share of the largest piece are dropped."""
    max_crumb_faces: CountOrNone = 100
    """Pieces with so many faces are kept, however large the largest one is: turns of a coil that
    nothing joins, a second grain."""
    fill_holes: Literal["none", "small", "all"] = "small"
    """Which holes are closed: small ones continue the surface, all makes a closed body. The faces
    that do so have the property `filled` in mesh.ply: nobody saw what they show."""
    max_hole_edges: CountOrNone = 30
    """Holes with at most this many boundary edges are small."""
    max_edge_factor: Positive = 3.0
    """delaunay-2.5d leaves out triangles with longer edges, in units of that median distance."""
    tsdf_voxel_factor: Positive = 0.7
    """Edge of tsdf's voxels in the same unit."""
    tsdf_truncation_voxels: Positive = 3.0
    """Distances beyond so many voxels do not count in tsdf."""
    poisson_depth: Annotated[int, Interval(ge=1, le=16)] = 9
    """Octree depth of the Poisson surface: 8 coarse, 10 fine."""
    poisson_trim_quantile: Share = 0.02
    """Share of the least supported Poisson vertices to cut away."""

    # texture
    texture: Literal["albedo", "image"] = "albedo"
    """albedo takes the shading out, one law of the normal for all images, and mixes all that see a
    place; image shows the greys of the most frontal images, light and dark sides included."""
    max_texture_faces: Count = 40_000
    """The textured mesh is reduced to at most this many faces; mesh.ply keeps all."""
    max_texture_size_px: Annotated[int, Ge(16)] = 4096
    """The texture has about one texel per px of the images, but is no larger than this."""
