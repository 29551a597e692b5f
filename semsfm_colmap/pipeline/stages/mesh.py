"""dense/fused.ply -> mesh/mesh.ply, mesh.glb, mesh.obj and shading.json."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from semsfm_colmap.errors import InputError
from semsfm_colmap.io.layout import MESH_FOLDER
from semsfm_colmap.pipeline.project import Project
from semsfm_colmap.pipeline.stage import Stage, StageRun, files_in
from semsfm_colmap.pipeline.texture import TEXTURE_FILES
from semsfm_colmap.records import MeshRecord
from semsfm_colmap.segmentation.names import CLOUD_FILE
from semsfm_colmap.segmentation.options import ALL

if TYPE_CHECKING:
    from semsfm_colmap.config import Config
    from semsfm_colmap.surface.depth_view import DepthView


def run(on: StageRun) -> MeshRecord:
    """Mesh the fused cloud, then texture it where the libraries for that are there."""
    from semsfm_colmap.io.ply import read_ply_cloud, write_ply
    from semsfm_colmap.pipeline.texture import write_texture
    from semsfm_colmap.segmentation.files import select_part
    from semsfm_colmap.surface import build
    from semsfm_colmap.surface.files import project_views

    project, options = on.project, on.config.surface
    cloud = read_ply_cloud(project.dense / "fused.ply")
    model = project.read_main_model()
    views: Sequence[DepthView] = project_views(model, project.dense / "depth_maps")
    part = on.config.segmentation.part
    if part != ALL:
        # depth maps show all parts
        cloud, views = select_part(cloud, project.segments, part), ()
    with on.reporter.progress("meshing"):
        solution = build.mesh(cloud, options, views)
    if solution.value is None or len(solution.value.faces) == 0:
        raise InputError(
            f"no surface could be made from the {len(cloud.points)} points: {solution.message}"
        )
    surface = solution.value
    project.mesh.mkdir(exist_ok=True)
    write_ply(project.mesh / "mesh.ply", surface)
    notes: tuple[str, ...] = () if part == ALL else (f"the mesh is of the part {part} alone",)
    with on.reporter.progress("texture") as progress:
        said = write_texture(
            surface, model, project.images, project.mesh, options, progress=progress
        )
    for note in said:
        notes += (note,)
        on.reporter.warn(note)
    record = build.mesh_record(surface, options.method, notes)
    for line in build.mesh_lines(record, model.world_unit):
        on.reporter.say(line)
    return record


def labels(project: Project, config: Config) -> Sequence[Path]:
    """The labels of the cloud, where a part alone is meshed."""
    return [] if config.segmentation.part == ALL else [project.segments / CLOUD_FILE]


STAGE = Stage(
    name="mesh",
    help="surface mesh and texture",
    description="Surface mesh and texture.",
    sections=("surface", "segmentation"),
    outputs=lambda p: [p.mesh / "mesh.ply"],
    writes=lambda p: [path for name in TEXTURE_FILES for path in files_in(p.mesh, name)],
    run=run,
    inputs=labels,
    places=(MESH_FOLDER,),
    optional=True,
    needs_open3d=True,
)
