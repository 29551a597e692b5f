"""The surface stages on a project folder."""

from __future__ import annotations

from semsfm_colmap.config import Config
from semsfm_colmap.pipeline.project import Project
from semsfm_colmap.pipeline.reporter import Reporter
from semsfm_colmap.pipeline.stages import Summary, read_main_model


def densify(project: Project, config: Config, reporter: Reporter) -> Summary:
    """Placeholder until the dense stage lands."""
    from semsfm_colmap.surface.cloud import sparse_cloud
    from semsfm_colmap.surface.files import write_ply

    project.dense.mkdir(exist_ok=True)
    write_ply(project.dense / "fused.ply", sparse_cloud(read_main_model(project), config.surface))
    return {}


def mesh(project: Project, config: Config, reporter: Reporter) -> Summary:
    """dense/fused.ply -> mesh/mesh.ply."""
    from semsfm_colmap.surface.ball_pivoting import mesh_cloud
    from semsfm_colmap.surface.files import read_ply_cloud, write_ply

    cloud = read_ply_cloud(project.dense / "fused.ply")
    surface = mesh_cloud(cloud, config.surface)
    project.mesh.mkdir(exist_ok=True)
    write_ply(project.mesh / "mesh.ply", surface)
    reporter.say(f"mesh: {len(surface.vertices)} vertices, {len(surface.faces)} faces")
    return {"num_vertices": len(surface.vertices), "num_faces": len(surface.faces)}
