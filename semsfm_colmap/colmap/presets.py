"""Settings that COLMAP needs with cameras this far away, as project.ini and pycolmap's options.

- ``max_focal_length_ratio`` (10 by default) throws every point of a long-focal camera away;
  pycolmap has it in three places, COLMAP's command line in one.
- The focal length is fixed: against the distance it is not observable.
- ``max_depth_error`` of the fusion is relative to the depth: at a distance of f px, 1 % is
  thousands of px and fuses front and back. It becomes the wanted tolerance in px over f.
- PatchMatch takes the depth range from the points and stretches it by 25 % of the *distance*:
  it is given explicitly.
- Poisson's trim of 10 leaves nothing of clouds of this density; 5 does.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

MAX_FOCAL_LENGTH_RATIO = 1e9
"""Beyond any telecentric pinhole: f / max(W, H) is 1e2 to 1e5."""
POISSON_TRIM = 5.0


@dataclass(frozen=True, kw_only=True)
class DensePreset:
    """What the dense stage must be told about one workspace."""

    depth_min: float
    """World units"""
    depth_max: float
    max_depth_error: float
    """Relative to the depth"""
    min_num_pixels: int


COMMAND_SECTIONS = {
    "mapper": "Mapper",
    "point_triangulator": "Mapper",
    "bundle_adjuster": "BundleAdjustment",
    "patch_match_stereo": "PatchMatchStereo",
    "stereo_fusion": "StereoFusion",
    "poisson_mesher": "PoissonMeshing",
}
"""The section of each of COLMAP's commands that reads one of ours."""


def settings(dense: DensePreset | None = None) -> dict[str, dict[str, str]]:
    """Section -> key -> value; keys that COLMAP 3.8 and 4 both know."""
    sections: dict[str, dict[str, str]] = {
        "BundleAdjustment": {
            "refine_focal_length": "0",
            "refine_principal_point": "0",
            "refine_extra_params": "0",
        },
        "Mapper": {
            "max_focal_length_ratio": f"{MAX_FOCAL_LENGTH_RATIO:.0f}",
            "ba_refine_focal_length": "0",
            "ba_refine_principal_point": "0",
            "ba_refine_extra_params": "0",
        },
        "PoissonMeshing": {"trim": f"{POISSON_TRIM:g}"},
    }
    if dense is not None:
        sections["PatchMatchStereo"] = {
            "depth_min": f"{dense.depth_min:.9g}",
            "depth_max": f"{dense.depth_max:.9g}",
        }
        sections["StereoFusion"] = {
            "max_depth_error": f"{dense.max_depth_error:.6g}",
            "min_num_pixels": str(dense.min_num_pixels),
        }
    return sections


def project_ini(dense: DensePreset | None = None) -> str:
    """A project.ini for COLMAP's GUI (File > Open project).

    A single command refuses an ini with another command's sections and does not combine one with
    flags: `command_flags` is for those.
    """
    lines: list[str] = []
    for section, values in settings(dense).items():
        lines.append(f"[{section}]")
        lines += [f"{key}={value}" for key, value in values.items()]
    return "\n".join(lines) + "\n"


def command_flags(command: str, dense: DensePreset | None = None) -> list[str]:
    """The same settings as flags of one of COLMAP's commands."""
    section = COMMAND_SECTIONS[command]
    values = settings(dense).get(section, {})
    return [part for key, value in values.items() for part in (f"--{section}.{key}", value)]


def command_lines(dense: DensePreset | None = None) -> str:
    """A text with the flags of every command, for people."""
    lines = ["# COLMAP's commands need these flags with cameras this far away."]
    for command in COMMAND_SECTIONS:
        flags = command_flags(command, dense)
        if flags:
            lines.append(f"colmap {command} {' '.join(flags)}")
    return "\n".join(lines) + "\n"


def pipeline_options() -> Any:
    """pycolmap.IncrementalPipelineOptions for mapping and triangulation with the exported cameras.

    Seed it with cameras that have ``has_prior_focal_length``; pass it to
    ``pycolmap.triangulate_points`` or ``incremental_mapping``.
    """
    from semsfm_colmap.colmap.library import pycolmap

    options = pycolmap.IncrementalPipelineOptions()
    options.max_focal_length_ratio = MAX_FOCAL_LENGTH_RATIO
    options.mapper.max_focal_length_ratio = MAX_FOCAL_LENGTH_RATIO
    options.triangulation.max_focal_length_ratio = MAX_FOCAL_LENGTH_RATIO
    options.ba_refine_focal_length = False
    options.ba_refine_principal_point = False
    options.ba_refine_extra_params = False
    return options


def bundle_adjustment_options() -> Any:
    """pycolmap.BundleAdjustmentOptions with the focal length fixed."""
    from semsfm_colmap.colmap.library import pycolmap

    options = pycolmap.BundleAdjustmentOptions()
    options.refine_focal_length = False
    options.refine_principal_point = False
    options.refine_extra_params = False
    options.print_summary = False
    return options


def stereo_fusion_options(dense: DensePreset) -> Any:
    """pycolmap.StereoFusionOptions for a workspace of ours."""
    from semsfm_colmap.colmap.library import pycolmap

    options = pycolmap.StereoFusionOptions()
    options.max_depth_error = dense.max_depth_error
    options.min_num_pixels = dense.min_num_pixels
    return options


def poisson_meshing_options(depth: int = 10) -> Any:
    """pycolmap.PoissonMeshingOptions that do not trim everything away."""
    from semsfm_colmap.colmap.library import pycolmap

    options = pycolmap.PoissonMeshingOptions()
    options.trim = POISSON_TRIM
    options.depth = depth
    return options
