"""Comparing a project with the truth of its series."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from semsfm_colmap.bounds import CountOrNone, hold
from semsfm_colmap.colmap.model.sparse import read_model
from semsfm_colmap.evaluation.compare import evaluate
from semsfm_colmap.evaluation.table import format_evaluation
from semsfm_colmap.evaluation.truth import load_truth
from semsfm_colmap.pipeline.project import open_project


def evaluate_project(
    project_path: Path, truth_path: Path, *, model: int = 0
) -> tuple[dict[str, Any], str]:
    """Figures of a model of a project, and of the mesh for model 0, against the truth; a table."""
    from semsfm_colmap.io.ply import read_ply_mesh

    hold("model", model, CountOrNone)
    project = open_project(project_path)
    truth = load_truth(Path(truth_path))
    reconstruction = read_model(project.sparse / str(model))
    mesh_file = project.mesh / "mesh.ply"
    mesh = read_ply_mesh(mesh_file) if model == 0 and mesh_file.is_file() else None
    figures = evaluate(reconstruction, truth, mesh)
    return figures, format_evaluation(figures)
