"""The meshing methods side by side on the same dense clouds.

A PROJECT is a folder with sparse/ and dense/ of a series; its truth is a folder with truth.json and
mesh.npz. A project without a truth has no accuracy and completeness. Each method meshes
dense/fused.ply (tsdf integrates dense/depth_maps besides) with the default options; distances are
those of `semsfm evaluate`, in px of the images:

accuracy       distance of the mesh's vertices to the true surface, median and 95th percentile
completeness   share of the true surface seen by an image that has the mesh within 2 px
open edges     edges with one face, of holes and of the rim
sound          edge-manifold, one outside, no face twice or without area, as trimesh sees it

Times are wall-clock seconds on a shared machine: compare rows of one series, never runs.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks import tables
from semsfm_colmap.config import config_from_dict
from semsfm_colmap.errors import InputError
from semsfm_colmap.evaluation.compare import evaluate
from semsfm_colmap.evaluation.truth import Truth, load_truth
from semsfm_colmap.io.ply import read_ply_cloud
from semsfm_colmap.pipeline.project import Project
from semsfm_colmap.surface import build
from semsfm_colmap.surface.files import project_views
from semsfm_colmap.surface.mesh.methods.registry import METHODS
from semsfm_colmap.types import TriangleMesh

COMMAND = "surface_methods"
HEAD = (
    "series",
    "method",
    "s",
    "faces",
    "accuracy px",
    "95 % px",
    "completeness %",
    "open edges",
    "pieces",
    "sound",
    "volume",
    "volume of the hull",
)


def rows(project: Project, truth: Truth | None, methods: Sequence[str]) -> list[list[object]]:
    """A row a method."""
    cloud = read_ply_cloud(project.dense / "fused.ply")
    model = project.read_main_model()
    series = project.read_series()
    offset = series.frames[0].crop_px[:2]
    views = project_views(model, project.dense / "depth_maps")
    result: list[list[object]] = []
    for name in methods:
        options = config_from_dict({"surface": {"method": name}}).surface
        start = time.perf_counter()
        solution = build.mesh(cloud, options, views if name == "tsdf" else ())
        seconds = time.perf_counter() - start
        head = [series_name(project, truth), name, f"{seconds:.1f}"]
        if solution.value is None:
            reason = solution.message.partition(":")[0]
            result.append([*head, reason, *[""] * (len(HEAD) - len(head) - 1)])
            continue
        mesh = solution.value
        record = build.mesh_record(mesh, name)
        errors = ["", "", ""]
        if truth is not None:
            said = evaluate(model, truth, mesh, crop_offset_px=(float(offset[0]), float(offset[1])))
            errors = [
                f"{said['mesh_to_truth_abs_median_px']:.2f}",
                f"{said['mesh_to_truth_abs_p95_px']:.2f}",
                f"{said['truth_to_mesh_within_2px_percent']:.1f}",
            ]
        result.append(
            [
                *head,
                record.num_faces,
                *errors,
                record.num_boundary_edges,
                record.num_components,
                "yes" if is_sound(mesh) else "no",
                *(
                    "" if volume is None else f"{volume:.4g} {model.world_unit}^3"
                    for volume in (record.volume, record.hull_volume)
                ),
            ]
        )
    return result


def series_name(project: Project, truth: Truth | None) -> str:
    """The name of the truth's folder, of the one around it where that is `series`."""
    if truth is None:
        return project.path.name
    path = truth.path.resolve()
    return path.parent.name if path.name == "series" else path.name


def is_sound(mesh: TriangleMesh) -> bool:
    """Edge-manifold, one outside, no face twice or without area, by trimesh."""
    import trimesh

    other = trimesh.Trimesh(mesh.vertices, mesh.faces, process=True)  # welds vertices in one place
    edges = np.sort(other.edges, axis=1)
    _, count = np.unique(edges, axis=0, return_counts=True)
    twice = len(np.unique(np.sort(other.faces, axis=1), axis=0)) < len(other.faces)
    return bool(
        count.max() <= 2
        and other.is_winding_consistent
        and not twice
        and len(other.faces) == len(mesh.faces)
        and np.all(other.area_faces > 0)
    )


def main() -> None:
    """Mesh and put the table into its page."""
    parser = tables.parser(COMMAND, __doc__)
    parser.add_argument("project", nargs="+", metavar="PROJECT[:TRUTH]")
    parser.add_argument("--methods", nargs="+", choices=list(METHODS), default=list(METHODS))
    tables.add_page_option(parser, COMMAND)
    arguments = parser.parse_args()
    result: list[list[object]] = []
    for text in arguments.project:
        folder, _, truth = text.partition(":")
        project = Project(Path(folder))
        if not (project.dense / "fused.ply").is_file():
            raise InputError(f"{project.path} has no dense/fused.ply: run `semsfm densify` first")
        result += rows(project, load_truth(Path(truth)) if truth else None, arguments.methods)
        print(tables.table(HEAD, result), flush=True)
    if arguments.markdown:
        tables.put(arguments.markdown, COMMAND, tables.table(HEAD, result))


if __name__ == "__main__":
    main()
