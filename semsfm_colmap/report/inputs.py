"""Everything a report is made from, gathered by the caller: the report reads no files."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from semsfm_colmap.errors import UsageError
from semsfm_colmap.records import (
    FilteringRound,
    GoniometerRecord,
    GuidedFigures,
    ModelEntry,
    PairStatistics,
    Reliability,
    SurfaceHalves,
    TiltAgreement,
)
from semsfm_colmap.report.feature_study import FeatureStudy
from semsfm_colmap.report.images.evidence import SeriesEvidence
from semsfm_colmap.types import Array, Int, PointCloud, Reconstruction, SemSeries, TriangleMesh


@dataclass(frozen=True, kw_only=True)
class StageUsage:
    """What a stage took."""

    name: str
    seconds: float
    peak_memory_mb: float | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class ViewerInputs:
    """What the 3-D viewer shows beside the model and its surface; all of it may be missing."""

    textured: TriangleMesh | None = None
    """The surface with its texture, as a rule with fewer faces than `mesh`"""
    labels: Int | None = None
    """(V,) of the vertices of the mesh, by `semsfm segment`"""
    label_names: Mapping[str, int] = field(default_factory=dict)
    seen: Callable[[Int], tuple[Array, Array]] | None = None
    """For vertices of the mesh, by their numbers (K,): which images see them, and which they follow
    where they are measured, (K, M) each"""
    picture: Callable[[str], Array | None] = lambda name: None
    """The prepared image (H, W) uint8 of that name"""
    errors: Mapping[str, Any] | None = None
    """What lengths between vertices are uncertain by (`metrology.sizes.page_errors`)"""
    error_arrays: Mapping[str, Array] = field(default_factory=dict)
    """The arrays of it"""


@dataclass(frozen=True, kw_only=True, eq=False)
class ReportInputs:
    """What the report needs; everything after `series` may be missing."""

    reconstruction: Reconstruction
    series: SemSeries
    """All images that were given, registered or not, in acquisition order."""
    pairs: tuple[PairStatistics, ...] = ()
    stages: tuple[StageUsage, ...] = ()
    """In the order they ran."""
    notes: tuple[str, ...] = ()
    """Whole sentences: warnings and verdicts of the stages, each with its evidence."""
    rounds: tuple[FilteringRound, ...] = ()
    """Of filtering by reprojection error, in their order."""
    guided: GuidedFigures | None = None
    """What the guided second pass found; None without one."""
    reliability: Reliability | None = None
    """Total rotation with its error bar, camera models compared, what leaving an image out does."""
    tilt: TiltAgreement | None = None
    """Known tilts against the angles that the images show; None where none are known."""
    goniometer: GoniometerRecord | None = None
    """How the specimen was turned, where `semsfm goniometer` has measured it."""
    models: tuple[ModelEntry, ...] = ()
    """What was written below sparse/; the first is `reconstruction`."""
    mesh: TriangleMesh | None = None
    cloud: PointCloud | None = None
    surface_halves: SurfaceHalves | None = None
    """Two surfaces from disjoint halves of the frames compared, where that was asked for."""
    evidence: SeriesEvidence | None = None
    """Pixels, keypoints, matches and depth maps, for the panels of the images."""
    feature_study: FeatureStudy | None = None
    """Detectors and descriptors compared on the images, where that was done."""
    versions: Mapping[str, str] = field(default_factory=dict)
    viewer: ViewerInputs = field(default_factory=ViewerInputs)
    title: str = "SEM reconstruction"

    def __post_init__(self) -> None:
        if len(set(self.reconstruction.image_names)) < self.reconstruction.num_images:
            raise UsageError("reconstruction.image_names repeats a name; every image needs its own")

    @property
    def twin_written(self) -> bool:
        """True when sparse/1 holds the depth-reversed model."""
        return any(model.kind == "twin" and model.part == 0 for model in self.models)
