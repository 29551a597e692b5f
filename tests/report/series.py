"""A reconstruction with closed forms: points on a sphere, turned in known steps about one axis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any, Literal

import numpy as np

from semsfm_colmap.geometry.rotations import rotation_from_vector
from semsfm_colmap.records import (
    FilteringRound,
    GuidedFigures,
    ModelEntry,
    PairStatistics,
    Reliability,
    Rung,
    SurfaceHalves,
)
from semsfm_colmap.report.image_statistics import PoseMetrics
from semsfm_colmap.report.inputs import ReportInputs, StageUsage
from semsfm_colmap.report.metrics import Metrics
from semsfm_colmap.types import (
    DepthSign,
    Float,
    Observations,
    OrthographicCameras,
    PointCloud,
    Reconstruction,
    SemFrame,
    SemMetadata,
    SemSeries,
    TriangleMesh,
)

AXIS = np.array([0.05, 0.99, -0.1]) / np.linalg.norm([0.05, 0.99, -0.1])
SIZE_PX = (640, 480)
SCALE = 20.0
"""px per um, so that a pixel is 50 nm"""


def turned(angles_deg: Sequence[float] | Float, axis: Float = AXIS) -> Float:
    """Poses of a specimen turned about an axis fixed in the camera, from a general first pose."""
    first = rotation_from_vector(np.array([0.3, -0.5, 0.2]))
    return rotation_from_vector(np.deg2rad(np.asarray(angles_deg))[:, None] * axis) @ first


def make_reconstruction(
    angles_deg: Sequence[float] | Float,
    *,
    num_points: int = 400,
    sigma_px: tuple[float, float] = (0.3, 0.5),
    window: int = 3,
    seed: int = 0,
    **changes: Any,
) -> Reconstruction:
    """Points of radius 8 um; each is seen in the frames within `window` of its own one."""
    rng = np.random.default_rng(seed)
    R = turned(angles_deg)
    num = len(R)
    points = rng.normal(size=(num_points, 3))
    points *= 8.0 / np.linalg.norm(points, axis=1, keepdims=True)
    cameras = OrthographicCameras(
        cam_from_world=R,
        scale_px_per_unit=np.full(num, SCALE),
        translation_px=np.array([0.5 * SIZE_PX[0], 0.5 * SIZE_PX[1]]) + rng.normal(size=(num, 2)),
    )
    middle = np.arange(num_points) % num
    image_idx, track_idx = np.nonzero(np.abs(np.arange(num)[:, None] - middle) <= window)
    order = np.lexsort((image_idx, track_idx))
    image_idx, track_idx = image_idx[order], track_idx[order]
    noise = rng.normal(size=(len(image_idx), 2)) * sigma_px
    xy = cameras.project(points[track_idx], image_idx) + noise
    reconstruction = Reconstruction(
        image_names=tuple(f"frame_{i:03d}.png" for i in range(num)),
        image_size_px=np.tile(SIZE_PX, (num, 1)),
        cameras=cameras,
        points=points,
        observations=Observations(
            image_idx=image_idx,
            track_idx=track_idx,
            keypoint_idx=np.arange(len(image_idx)),
            xy=xy,
            num_images=num,
            num_tracks=num_points,
        ),
        inlier=np.ones(len(image_idx), dtype=np.bool_),
        world_unit="um",
        pixel_size_um=1.0 / SCALE,
        pixel_size_source="test chart",
        depth_sign=DepthSign(status="resolved", confidence=0.99, evidence={"visibility": 0.99}),
    )
    return replace(reconstruction, **changes)


def make_inputs(
    reconstruction: Reconstruction, *, names: Sequence[str] | None = None, **more: Any
) -> ReportInputs:
    """Inputs whose series is `names`, by default the registered images."""
    frames = tuple(
        SemFrame(
            name=name,
            width_px=SIZE_PX[0],
            height_px=SIZE_PX[1],
            source_path=name,
            crop_px=(0, 0, *SIZE_PX),
        )
        for name in (reconstruction.image_names if names is None else names)
    )
    return ReportInputs(
        reconstruction=reconstruction,
        series=more.pop("series", SemSeries(frames=frames)),
        **more,
    )


def chain_of_pairs(names: Sequence[str]) -> tuple[PairStatistics, ...]:
    """Each image matched with its next: 100 found, 10 static, 80 and then 75 kept."""
    return tuple(
        PairStatistics(
            image_name_1=a,
            image_name_2=b,
            num_matches=100,
            num_static_rejected=10,
            num_after_affine_ransac=80,
            num_after_distance_filter=75,
        )
        for a, b in pairwise(names)
    )


def cube(side: float = 1.0) -> TriangleMesh:
    """A closed cube of twelve triangles."""
    corners = side * np.array([[i >> 2 & 1, i >> 1 & 1, i & 1] for i in range(8)], dtype=np.float64)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    return TriangleMesh(vertices=corners, faces=np.array(faces))


def sphere(num_rings: int = 120) -> TriangleMesh:
    """A unit sphere of rings from pole to pole."""
    theta = np.linspace(0.0, np.pi, num_rings)
    phi = np.linspace(0.0, 2.0 * np.pi, 2 * num_rings, endpoint=False)
    t, p = np.meshgrid(theta, phi, indexing="ij")
    vertices = np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], axis=-1)
    i, j = np.meshgrid(np.arange(num_rings - 1), np.arange(2 * num_rings), indexing="ij")
    k = (j + 1) % (2 * num_rings)
    n = 2 * num_rings
    quads = np.stack([i * n + j, (i + 1) * n + j, (i + 1) * n + k, i * n + k], axis=-1)
    quads = quads.reshape(-1, 4)
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return TriangleMesh(vertices=vertices.reshape(-1, 3), faces=faces)


def empty_reconstruction(num_images: int = 0) -> Reconstruction:
    """Images without a single point."""
    full = make_reconstruction(np.arange(max(num_images, 1)) * 5.0, num_points=1)
    none = np.zeros(0, dtype=np.int64)
    return replace(
        full,
        image_names=full.image_names[:num_images],
        image_size_px=full.image_size_px[:num_images],
        cameras=full.cameras.select(np.arange(num_images)),
        points=np.zeros((0, 3)),
        observations=Observations(
            image_idx=none,
            track_idx=none,
            keypoint_idx=none,
            xy=np.zeros((0, 2)),
            num_images=num_images,
            num_tracks=0,
        ),
        inlier=np.zeros(0, dtype=np.bool_),
        depth_sign=DepthSign(status="ambiguous", confidence=0.5),
    )


def written(
    kind: Literal["model", "twin"] = "model", *, max_deviation_px: float = 0.01
) -> ModelEntry:
    """A model below sparse/, as the map stage records it."""
    return ModelEntry(
        model="sparse/0" if kind == "model" else "sparse/1",
        part=0,
        kind=kind,
        num_images=0,
        images=(),
        num_points=0,
        focal_length_px=1e6,
        max_deviation_px=max_deviation_px,
    )


def filtering_round(num_observations: int, threshold_px: float = 8.0) -> FilteringRound:
    """A round that left so many observations."""
    return FilteringRound(
        threshold_px=threshold_px,
        num_observations=num_observations,
        num_points=7,
        num_images=3,
        sigma_px=0.4,
        rms_px=0.5,
    )


def poses(metrics: Metrics) -> list[PoseMetrics]:
    """What is known of the registered images, in acquisition order."""
    return [image.pose for image in metrics.per_image if image.pose is not None]


def full_inputs() -> ReportInputs:
    """Inputs in which nothing is missing."""
    rec = make_reconstruction(
        np.arange(6) * 4.0,
        sigma_rotation_rad=np.full((6, 3), 1e-4),
        sigma_translation_px=np.full((6, 2), 0.02),
        sigma_scale=np.full(6, 1e-4),
        point_covariance=np.tile(0.01 * np.eye(3), (400, 1, 1)),
    )
    pairs = chain_of_pairs([*rec.image_names])
    inputs = make_inputs(
        rec,
        names=[*rec.image_names, "lost.png"],
        pairs=(*pairs, replace(pairs[0], failure="no overlap")),
        stages=(StageUsage(name="match", seconds=1.5, peak_memory_mb=200.0),),
        rounds=(filtering_round(100), filtering_round(90, 4.0)),
        guided=guided_figures(),
        reliability=reliability_figures(),
        models=(written(),),
        mesh=cube(),
        cloud=PointCloud(points=np.zeros((3, 3)), sigma=np.array([0.1, 0.2, 0.4])),
        surface_halves=SurfaceHalves(
            num_points=(3, 4),
            shared=0.9,
            rms_px=0.5,
            robust_rms_px=0.4,
            median_px=0.01,
            expected_px=1.2,
            ratio=0.33,
        ),
        versions={"numpy": "2.0"},
    )
    frames = tuple(
        replace(frame, metadata=SemMetadata(tilt_rad=0.1 * k))
        for k, frame in enumerate(inputs.series.frames)
    )
    return replace(inputs, series=SemSeries(frames=frames))


def guided_figures() -> GuidedFigures:
    """A guided pass that doubled the observations."""
    return GuidedFigures(
        num_passes=4,
        high_pass_px=2.0,
        num_places=51234,
        num_found=23456,
        num_observations_before=12000,
        num_observations=24001,
        mean_track_length_before=7.1,
        mean_track_length=13.8,
        sigma_before_px=0.372,
        sigma_px=0.161,
        largest_drift_px=0.418,
    )


def reliability_figures() -> Reliability:
    """A model that every rung of the ladder agrees on."""
    rung = Rung(name="orthographic", range_deg=20.0, bic=100.0, held_out_px=None, num_parameters=30)
    return Reliability(
        total_rotation_deg=20.0,
        total_rotation_sigma_deg=0.01,
        depth_uncertainty=0.001,
        best_model="orthographic",
        models=(rung,),
        drift_px={"frame_000.png": (0.1, -0.2)},
    )
