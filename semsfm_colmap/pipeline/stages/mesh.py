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
    from semsfm_colmap.surface.files import write_textured
    from semsfm_colmap.surface.mesh.vertex_sigma import with_vertex_sigma
    from semsfm_colmap.surface.texture.atlas import texture_mesh

    project, options = on.project, on.config.surface
    cloud = read_ply_cloud(project.dense / "fused.ply")
    solution = build.mesh(cloud, options)
    if solution.value is None or len(solution.value.faces) == 0:
        raise InputError(
            f"no surface could be made from the {len(cloud.points)} points: they are too few or "
            "too scattered; see the report for the images that match badly"
        )
    surface = with_vertex_sigma(solution.value, cloud)
    project.mesh.mkdir(exist_ok=True)
    write_ply(project.mesh / "mesh.ply", surface)
    on.reporter.say(f"mesh: {len(surface.vertices)} vertices, {len(surface.faces)} faces")
    notes: tuple[str, ...] = ()
    try:
        textured = texture_mesh(surface, project.read_main_model(), project.images, options)
        write_textured(textured, project.mesh)
    except (ImportError, MissingDependencyError) as error:
        notes = (f"the mesh was not textured: {error}",)
        on.reporter.warn(notes[0])
    extent = surface.vertices.max(axis=0) - surface.vertices.min(axis=0)
    return MeshRecord(
        num_vertices=len(surface.vertices),
        num_faces=len(surface.faces),
        extent=tuple(extent.tolist()),
        notes=notes,
    )


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
