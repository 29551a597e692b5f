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

    # dense stereo
    max_depth_map_size_px: int = 1024
    """Longer side of a depth map; larger images are reduced to it."""
    max_num_depth_maps: int = 48
    """Images that get a depth map; of longer series as many, spread over the directions."""
    min_reference_angle_deg: float = 3.0
    """Of images seen at smaller angles to one another only some get a depth map; all are matched
    against."""
    num_neighbors: int = 6
    """Images that each depth map is matched against."""
    min_baseline_deg: float = 2.0
    """Images seen at a smaller angle to the reference give no depth."""
    max_baseline_deg: float = 16.0
    """Images seen at a larger angle look too different."""
    depth_margin: float = 0.5
    """The sweep reaches this share of the sparse points' depth range beyond them: spines and rims
    have few points of their own."""
    sweep_step_px: float = 1.0
    """Parallax between two surfaces of a sweep, in px."""
    sweep_window_radius_px: int = 2
    """The sweeps correlate windows of 2 r + 1 px."""
    max_relief_px: float = 20.0
    """Depth that details may stand out from the half-size surface, in px of the depth map."""
    window_radius_px: int = 3
    """The refinement correlates windows of 2 r + 1 px."""
    window_grey_share: float = 0.27
    """Pixels that differ from the window's centre by this share of the contrast do not count."""
    visibility_spread: float = 0.4
    """A neighbour that correlates this much worse than the best one does not count."""
    slope_radius_px: int = 3
    """Local planes are fitted to depths within this distance."""
    num_refinements: int = 2
    """Gauss-Newton steps of each depth."""
    smoothness: float = 0.1
    """Pull of a depth to its local plane, as an inverse variance in px: 0.1 means 3 px."""
    min_correlation: float = 0.2
    """Depths whose windows correlate less are dropped."""
    min_speck_px: int = 60
    """Connected patches of fewer depth pixels are dropped."""

    # fusion
    num_fusion_neighbors: int = 10
    """Depth maps that each one is compared with."""
    max_fusion_angle_deg: float = 45.0
    """Depth maps seen at a larger angle are not compared."""
    consistency_px: float = 2.0
    """Surfaces of two depth maps agree within this distance, in px of the depth maps."""
    contradiction_px: float = 6.0
    """A point this far in front of another map's surface is contradicted by it."""
    min_consistent_maps: int = 1
    """Other depth maps that must agree with a point."""
    min_lone_confidence: float = 0.5
    """A depth that no other map agrees with or contradicts counts when it correlates this much."""
    max_fused_outlier_sigma: float = 5.0
    """As `max_outlier_sigma`, of the fused points, which depth maps have agreed on already."""
    spacing_px: float = 2.0
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
    ball_radius_factors: tuple[float, ...] = (1.0, 2.0, 4.0)
    """Ball radii in units of the median distance to the 8th neighbour."""
    thinning_factor: float = 0.6
    """Grid on which points are merged before meshing, in the same unit; 0 keeps all."""
    num_smoothing_iterations: int = 1
    """Passes that move points along their normals onto the local surface; 0 keeps the noise."""
    min_component_fraction: float = 0.005
    """Pieces with fewer faces than this share of the largest piece are dropped."""
    max_crumb_faces: int = 100
    """Pieces with so many faces are kept, however large the largest one is: turns of a coil that
    nothing joins, a second grain."""
    fill_holes: Literal["none", "small", "all"] = "small"
    """Which holes are closed: small ones continue the surface, all makes a closed body. The faces
    that do so have the property `filled` in mesh.ply: nobody saw what they show."""
    max_hole_edges: int = 30
    """Holes with at most this many boundary edges are small."""
    max_edge_factor: float = 3.0
    """delaunay-2.5d leaves out triangles with longer edges, in units of that median distance."""
    tsdf_voxel_factor: float = 0.7
    """Edge of tsdf's voxels in the same unit."""
    tsdf_truncation_voxels: float = 3.0
    """Distances beyond so many voxels do not count in tsdf."""
    poisson_depth: int = 9
    """Octree depth of the Poisson surface: 8 coarse, 10 fine."""
    poisson_trim_quantile: float = 0.02
    """Share of the least supported Poisson vertices to cut away."""

    # texture
    texture: Literal["albedo", "image"] = "albedo"
    """albedo takes the shading out, one law of the normal for all images, and mixes all that see a
    place; image shows the greys of the most frontal images, light and dark sides included."""
    max_texture_faces: int = 40_000
    """The textured mesh is reduced to at most this many faces; mesh.ply keeps all."""
    max_texture_size_px: int = 4096
    """The texture has about one texel per px of the images, but is no larger than this."""
