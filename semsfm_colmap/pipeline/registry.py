"""The stages in their order."""

from __future__ import annotations

from semsfm_colmap.errors import UsageError
from semsfm_colmap.pipeline.stage import Stage
from semsfm_colmap.pipeline.stages import densify, extract, ingest, match, mesh, report
from semsfm_colmap.pipeline.stages import map as map_stage

STAGES: tuple[Stage, ...] = (
    ingest.STAGE,
    extract.STAGE,
    match.STAGE,
    map_stage.STAGE,
    densify.STAGE,
    mesh.STAGE,
    report.STAGE,
)
STAGE_NAMES = tuple(stage.name for stage in STAGES)


def find_stage(name: str) -> Stage:
    """The stage of that name."""
    if name not in STAGE_NAMES:
        raise UsageError(f"unknown stage {name}: the stages are {', '.join(STAGE_NAMES)}")
    return STAGES[STAGE_NAMES.index(name)]


def stages_after(name: str) -> tuple[str, ...]:
    """The names of the stages that build on one: what is stale when its results change."""
    return STAGE_NAMES[STAGE_NAMES.index(find_stage(name).name) + 1 :]
