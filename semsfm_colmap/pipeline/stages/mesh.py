"""dense/fused.ply -> mesh/mesh.ply, mesh.glb and mesh.obj."""

from __future__ import annotations

from semsfm_colmap.errors import InputError, MissingDependencyError
from semsfm_colmap.io.layout import MESH_FOLDER
from semsfm_colmap.pipeline.stage import Stage, StageRun
from semsfm_colmap.records import MeshRecord


def run(on: StageRun) -> MeshRecord:
    """Mesh the fused cloud, then texture it where the libraries for that are there."""
    from semsfm_colmap.io.ply import read_ply_cloud, write_ply
    from semsfm_colmap.surface import build
    from semsfm_colmap.surface.files import project_views, write_textured
    from semsfm_colmap.surface.texture.atlas import texture_mesh

    project, options = on.project, on.config.surface
    cloud = read_ply_cloud(project.dense / "fused.ply")
    model = project.read_main_model()
    views = project_views(model, project.dense / "depth_maps")
    solution = build.mesh(cloud, options, views)
    if solution.value is None or len(solution.value.faces) == 0:
        raise InputError(
            f"no surface could be made from the {len(cloud.points)} points: {solution.message}"
        )
    surface = solution.value
    project.mesh.mkdir(exist_ok=True)
    write_ply(project.mesh / "mesh.ply", surface)
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
