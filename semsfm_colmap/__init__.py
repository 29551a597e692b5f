"""Structure from motion for scanning electron microscope series (parallel projection).

The public names, loaded when they are first used:

- `reconstruct`, `run_stages`: images to a project; some stages of a project
- `Config`, `read_config`, `write_config`, `preset`: all options; those of a quality
- `merge_projects`: several series of one specimen in one model
- `segment_project`: specimen and what holds it told apart
- `plan`: how many images over which angle, or which angles to add to a project
- `measure_rotation`: the actuator that turned the specimen, as a goniometer
- `compare_projects`: two surfaces of one specimen, before and after wear or etching
- `height_map`: heights of a surface on a grid, with areal parameters and their uncertainties
- `measure`: lengths, angles, radii, heights, areas, volumes, each with its uncertainty budget
- `map_database`, `reconstruct_from_database`: from any COLMAP database
- `mesh_colmap`: a mesh of any COLMAP folder
- `export_project`, `adopt_model`, `read_pinhole_model`: to other programs and back
- `read_model`: a `Reconstruction` from a sparse folder
- `map_observations`: `Observations` to reconstructions, without any file
- `evaluate`, `load_truth`, `synthesize`, `SynthesizeOptions`: truth
- `Reconstruction`: cameras, points and observations; other types are in `semsfm_colmap.types`
- `IngestOptions`, `FeatureOptions`, `MatchingOptions`, `TrackOptions`, `FactorizationOptions`,
  `GuidedOptions`, `RefinementOptions`, `ExportOptions`, `SurfaceOptions`, `SegmentationOptions`:
  the sections of `Config`
- `SemSfmError`, the base of `InputError`, `UsageError`, `ClusterError`, `MissingDependencyError`
"""

from __future__ import annotations

import importlib
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from semsfm_colmap.io.compiled import place_compiled
from semsfm_colmap.version import __version__ as __version__

# numba would try TBB first, of which open3d loads a version that numba warns about and refuses
os.environ.setdefault("NUMBA_THREADING_LAYER_PRIORITY", "omp workqueue tbb")
place_compiled(Path(__file__).parent)

if TYPE_CHECKING:
    from semsfm_colmap.colmap.model.pinhole_reading import read_pinhole_model as read_pinhole_model
    from semsfm_colmap.colmap.model.sparse import read_model as read_model
    from semsfm_colmap.colmap.options import ExportOptions as ExportOptions
    from semsfm_colmap.config import Config as Config
    from semsfm_colmap.config import FeatureOptions as FeatureOptions
    from semsfm_colmap.config import preset as preset
    from semsfm_colmap.config import read_config as read_config
    from semsfm_colmap.config import write_config as write_config
    from semsfm_colmap.errors import ClusterError as ClusterError
    from semsfm_colmap.errors import InputError as InputError
    from semsfm_colmap.errors import MissingDependencyError as MissingDependencyError
    from semsfm_colmap.errors import SemSfmError as SemSfmError
    from semsfm_colmap.errors import UsageError as UsageError
    from semsfm_colmap.evaluation.compare import evaluate as evaluate
    from semsfm_colmap.evaluation.truth import load_truth as load_truth
    from semsfm_colmap.factorization.options import FactorizationOptions as FactorizationOptions
    from semsfm_colmap.ingest.options import IngestOptions as IngestOptions
    from semsfm_colmap.mapping.parts import map_observations as map_observations
    from semsfm_colmap.matching.guided.options import GuidedOptions as GuidedOptions
    from semsfm_colmap.matching.options import MatchingOptions as MatchingOptions
    from semsfm_colmap.pipeline.adopt import adopt_model as adopt_model
    from semsfm_colmap.pipeline.compare_surfaces import compare_projects as compare_projects
    from semsfm_colmap.pipeline.export import export_project as export_project
    from semsfm_colmap.pipeline.foreign.import_database import (
        reconstruct_from_database as reconstruct_from_database,
    )
    from semsfm_colmap.pipeline.foreign.map_database import map_database as map_database
    from semsfm_colmap.pipeline.foreign.mesh_colmap import mesh_colmap as mesh_colmap
    from semsfm_colmap.pipeline.goniometer import measure_rotation as measure_rotation
    from semsfm_colmap.pipeline.height_map import height_map as height_map
    from semsfm_colmap.pipeline.measure import measure as measure
    from semsfm_colmap.pipeline.merge import merge_projects as merge_projects
    from semsfm_colmap.pipeline.plan import plan as plan
    from semsfm_colmap.pipeline.runner import reconstruct as reconstruct
    from semsfm_colmap.pipeline.runner import run_stages as run_stages
    from semsfm_colmap.pipeline.segment import segment_project as segment_project
    from semsfm_colmap.refinement.options import RefinementOptions as RefinementOptions
    from semsfm_colmap.segmentation.options import SegmentationOptions as SegmentationOptions
    from semsfm_colmap.surface.options import SurfaceOptions as SurfaceOptions
    from semsfm_colmap.synthetic.options import SynthesizeOptions as SynthesizeOptions
    from semsfm_colmap.synthetic.series import synthesize as synthesize
    from semsfm_colmap.tracks.options import TrackOptions as TrackOptions
    from semsfm_colmap.types import Reconstruction as Reconstruction

_HOMES = {
    "ClusterError": "errors",
    "Config": "config",
    "ExportOptions": "colmap.options",
    "FactorizationOptions": "factorization.options",
    "FeatureOptions": "config",
    "GuidedOptions": "matching.guided.options",
    "IngestOptions": "ingest.options",
    "InputError": "errors",
    "MatchingOptions": "matching.options",
    "MissingDependencyError": "errors",
    "Reconstruction": "types",
    "RefinementOptions": "refinement.options",
    "SegmentationOptions": "segmentation.options",
    "SemSfmError": "errors",
    "SurfaceOptions": "surface.options",
    "SynthesizeOptions": "synthetic.options",
    "TrackOptions": "tracks.options",
    "UsageError": "errors",
    "adopt_model": "pipeline.adopt",
    "compare_projects": "pipeline.compare_surfaces",
    "evaluate": "evaluation.compare",
    "export_project": "pipeline.export",
    "height_map": "pipeline.height_map",
    "load_truth": "evaluation.truth",
    "map_database": "pipeline.foreign.map_database",
    "map_observations": "mapping.parts",
    "measure": "pipeline.measure",
    "measure_rotation": "pipeline.goniometer",
    "merge_projects": "pipeline.merge",
    "mesh_colmap": "pipeline.foreign.mesh_colmap",
    "plan": "pipeline.plan",
    "preset": "config",
    "read_config": "config",
    "read_model": "colmap.model.sparse",
    "read_pinhole_model": "colmap.model.pinhole_reading",
    "reconstruct": "pipeline.runner",
    "reconstruct_from_database": "pipeline.foreign.import_database",
    "run_stages": "pipeline.runner",
    "segment_project": "pipeline.segment",
    "synthesize": "synthetic.series",
    "write_config": "config",
}
__all__ = sorted([*_HOMES, "__version__"])


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(importlib.import_module(f"semsfm_colmap.{_HOMES[name]}"), name)
    raise AttributeError(f"module 'semsfm_colmap' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
