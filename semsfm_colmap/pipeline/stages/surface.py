"""The surface stages on a project folder: depth maps and their fusion, mesh and texture."""

from __future__ import annotations

import numpy as np

from semsfm_colmap.config import Config
from semsfm_colmap.errors import InputError, MissingDependencyError
from semsfm_colmap.io.atomic import folder_aside
from semsfm_colmap.pipeline.project import Project
from semsfm_colmap.pipeline.reporter import Reporter
from semsfm_colmap.pipeline.stages.all import Summary, read_main_model


def densify(project: Project, config: Config, reporter: Reporter) -> Summary:
    """images/, sparse/0 -> dense/depth_maps/, dense/fused.ply.

    Where the depth maps agree on too little (few images, small angles) the fused cloud is the
    sparse one, and that is said.
    """
    from semsfm_colmap.io.ply import write_ply
    from semsfm_colmap.surface.build import fuse_depth_maps
    from semsfm_colmap.surface.files import DepthMapFolder, write_depth_map
    from semsfm_colmap.surface.stereo.plane_sweep import sweep_depth_maps
    from semsfm_colmap.surface.stereo.views import choose_references

    reconstruction = read_main_model(project)
    options = config.surface
    # the maps are written aside and replace those of an earlier run as a whole
    folder = project.dense / "depth_maps"
    references = choose_references(reconstruction.cameras, options.max_num_depth_maps)
    names: list[str] = []
    with folder_aside(folder) as aside, reporter.progress("depth maps") as progress:
        for depth_map in sweep_depth_maps(
            reconstruction, references, project.images, project.masks_or_none, options
        ):
            write_depth_map(aside, depth_map)
            names.append(depth_map.image_name)
            progress(len(names), len(references))
    with reporter.progress("fusing") as progress:
        fused = fuse_depth_maps(
            DepthMapFolder(folder, tuple(names)),
            reconstruction,
            project.images,
            options,
            progress=progress,
        )
    if fused.value is None:
        raise InputError(fused.message)
    cloud = fused.value
    notes = [fused.message] if fused.message else []
    write_ply(project.dense / "fused.ply", cloud)
    reporter.say(f"densify: {len(names)} depth maps, {len(cloud.points)} points")
    for note in notes:
        reporter.say(note)
    return {
        "num_depth_maps": len(names),
        "num_points": len(cloud.points),
        "coverage": fused.diagnostics.get("coverage"),
        "notes": notes,
    }


def mesh(project: Project, config: Config, reporter: Reporter) -> Summary:
    """dense/fused.ply -> mesh/mesh.ply, mesh.glb and mesh.obj."""
    from semsfm_colmap.io.ply import read_ply_cloud, write_ply
    from semsfm_colmap.surface import build
    from semsfm_colmap.surface.files import write_textured
    from semsfm_colmap.surface.texture.atlas import texture_mesh

    cloud = read_ply_cloud(project.dense / "fused.ply")
    solution = build.mesh(cloud, config.surface)
    if solution.value is None or len(solution.value.faces) == 0:
        raise InputError(
            f"no surface could be made from the {len(cloud.points)} points: they are too few or "
            "too scattered; see the report for the images that match badly"
        )
    surface = solution.value
    project.mesh.mkdir(exist_ok=True)
    write_ply(project.mesh / "mesh.ply", surface)
    reporter.say(f"mesh: {len(surface.vertices)} vertices, {len(surface.faces)} faces")
    notes: list[str] = []
    try:
        textured = texture_mesh(surface, read_main_model(project), project.images, config.surface)
        write_textured(textured, project.mesh)
    except (ImportError, MissingDependencyError) as error:
        notes.append(f"the mesh was not textured: {error}")
        reporter.warn(notes[-1])
    extent = np.ptp(np.asarray(surface.vertices), axis=0)
    return {
        "num_vertices": len(surface.vertices),
        "num_faces": len(surface.faces),
        "extent": extent.tolist(),
        "notes": notes,
    }
