"""The numbers of the report, and nothing but numbers: `docs/report.md` says what each one means.

Names carry their unit (``_px _nm _deg _seconds _mb``); ``_world`` stands for the unit in
``world.unit``. None stands for "not known", never for zero. Frames are numbered from 1 in the
order of acquisition. `metrics_json` gives them the shape of metrics.json.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from semsfm_colmap.records import GuidedFigures, ModelEntry, Reliability, SurfaceHalves
from semsfm_colmap.report.filtering_statistics import RoundMetrics, filtering_statistics
from semsfm_colmap.report.frames import order_frames
from semsfm_colmap.report.image_statistics import ImageMetrics, image_statistics, relative_scale
from semsfm_colmap.report.inputs import ReportInputs, StageUsage
from semsfm_colmap.report.magnification_trend import MagnificationTrend, magnification_trend
from semsfm_colmap.report.match_statistics import MatchMetrics, match_statistics
from semsfm_colmap.report.mesh_statistics import MeshMetrics, mesh_statistics
from semsfm_colmap.report.motion_statistics import RotationMetrics, motion_statistics
from semsfm_colmap.report.residual_statistics import ResidualMetrics, residual_statistics
from semsfm_colmap.report.structure_statistics import (
    CoVisibility,
    StructureMetrics,
    co_visibility,
    structure_statistics,
)
from semsfm_colmap.report.world_statistics import WorldMetrics, world_statistics
from semsfm_colmap.types import DepthSign, PointCloud


@dataclass(frozen=True, kw_only=True)
class RegisteredImages:
    """Images in the series, and those with a pose."""

    num_given: int
    num_registered: int
    missing: tuple[str, ...]
    """names of the others"""


@dataclass(frozen=True, kw_only=True)
class CloudMetrics:
    """Size of the dense cloud, and how sure it is."""

    num_points: int
    median_sigma_world: float | None
    """standard deviation along the normal; None where none is known"""
    p95_sigma_world: float | None
    half_series: SurfaceHalves | None
    """two surfaces from disjoint halves of the frames; None where they were not asked for"""


@dataclass(frozen=True, kw_only=True, eq=False)
class Metrics:
    """All numbers of the report; None for a part that was not made or has no data."""

    images: RegisteredImages
    world: WorldMetrics
    structure: StructureMetrics
    residuals: ResidualMetrics | None
    """None without a kept observation"""
    rotation: RotationMetrics | None
    """None where nothing turns"""
    reliability: Reliability | None
    depth_sign: DepthSign
    twin_written: bool
    matches: MatchMetrics
    filtering_rounds: tuple[RoundMetrics, ...]
    guided: GuidedFigures | None
    telecentric: ModelEntry | None
    """the model as it was written, with a pinhole camera far away"""
    models: tuple[ModelEntry, ...]
    """all that lie below sparse/"""
    mesh: MeshMetrics | None
    cloud: CloudMetrics | None
    magnification_trend: MagnificationTrend | None
    """the part of the magnification that follows the angle; None for few images or no rotation"""
    stages: tuple[StageUsage, ...]
    versions: Mapping[str, str]
    notes: tuple[str, ...]
    per_image: tuple[ImageMetrics, ...]
    co_visibility: CoVisibility


def _cloud(cloud: PointCloud, halves: SurfaceHalves | None) -> CloudMetrics:
    sigma = cloud.sigma if cloud.sigma is not None and len(cloud.sigma) else None
    return CloudMetrics(
        num_points=len(cloud.points),
        median_sigma_world=None if sigma is None else float(np.median(sigma)),
        p95_sigma_world=None if sigma is None else float(np.percentile(sigma, 95)),
        half_series=halves,
    )


def compute_metrics(inputs: ReportInputs) -> Metrics:
    """All numbers of the report."""
    rec = inputs.reconstruction
    frames = order_frames(inputs)
    residual = rec.residuals()
    world = world_statistics(inputs)
    rotation, motion = motion_statistics(inputs, frames)
    return Metrics(
        images=RegisteredImages(
            num_given=len(frames.names),
            num_registered=len(frames.registered),
            missing=frames.missing,
        ),
        world=world,
        structure=structure_statistics(rec),
        residuals=residual_statistics(rec, residual, world.pixel_size_nm),
        rotation=rotation,
        reliability=inputs.reliability,
        depth_sign=rec.depth_sign,
        twin_written=inputs.twin_written,
        matches=match_statistics(inputs.pairs),
        filtering_rounds=filtering_statistics(inputs.rounds),
        guided=inputs.guided,
        telecentric=inputs.models[0] if inputs.models else None,
        models=inputs.models,
        mesh=None if inputs.mesh is None else mesh_statistics(inputs.mesh),
        cloud=None if inputs.cloud is None else _cloud(inputs.cloud, inputs.surface_halves),
        magnification_trend=magnification_trend(motion.angle_deg, relative_scale(rec, frames)),
        stages=inputs.stages,
        versions=inputs.versions,
        notes=(*inputs.notes, *inputs.series.warnings),
        per_image=image_statistics(inputs, frames, residual, motion),
        co_visibility=co_visibility(rec, frames),
    )
