"""dense/fused.ply -> mesh/mesh.ply, mesh.glb and mesh.obj."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from semsfm_colmap.errors import InputError, MissingDependencyError
from semsfm_colmap.io.layout import MESH_FOLDER
from semsfm_colmap.pipeline.stage import Stage, StageRun
from semsfm_colmap.records import MeshRecord

if TYPE_CHECKING:
    from semsfm_colmap.surface.depth_view import DepthView


def run(on: StageRun) -> MeshRecord:
    """Mesh the fused cloud, then texture it where the libraries for that are there."""
    from semsfm_colmap.io.ply import read_ply_cloud, write_ply
    from semsfm_colmap.surface import build
    from semsfm_colmap.surface.files import write_textured
    from semsfm_colmap.surface.texture.atlas import texture_mesh

    project, options = on.project, on.config.surface
    cloud = read_ply_cloud(project.dense / "fused.ply")
    solution = build.mesh(cloud, options, views(on) if options.method == "tsdf" else ())
    if solution.value is None or len(solution.value.faces) == 0:
        raise InputError(
            f"no surface could be made from the {len(cloud.points)} points: {solution.message}"
        )
    surface = solution.value
    project.mesh.mkdir(exist_ok=True)
    write_ply(project.mesh / "mesh.ply", surface)
    model = project.read_main_model()
    notes: tuple[str, ...] = ()
    try:
        textured = texture_mesh(surface, model, project.images, options)
        write_textured(textured, project.mesh)
    except (ImportError, MissingDependencyError) as error:
        notes = (f"the mesh was not textured: {error}",)
        on.reporter.warn(notes[0])
    record = build.mesh_record(surface, options.method, notes)
    for line in build.mesh_lines(record, model.world_unit):
        on.reporter.say(line)
    return record


def views(on: StageRun) -> Sequence[DepthView]:
    """The depth maps with their cameras, read when they are asked for."""
    from semsfm_colmap.surface.depth_view import LazyViews, parallel_view
    from semsfm_colmap.surface.files import depth_map_path, read_depth_map

    model, folder = on.project.read_main_model(), on.project.dense / "depth_maps"
    rows = [i for i, name in enumerate(model.image_names) if depth_map_path(folder, name).is_file()]

    def view(k: int) -> DepthView:
        i = rows[k]
        depth_map = read_depth_map(folder, model.image_names[i])
        return parallel_view(model.cameras, i, model.image_size_px[i], depth_map)

    return LazyViews(view, len(rows))


STAGE = Stage(
    name="mesh",
    help="surface mesh and texture",
    description="Surface mesh and texture.",
    sections=("surface",),
    outputs=lambda p: [p.mesh / "mesh.ply"],
    run=run,
    places=(MESH_FOLDER,),
    optional=True,
)
