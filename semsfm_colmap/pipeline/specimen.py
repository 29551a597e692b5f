"""sparse/0, mesh/, segments/, masks/ -> `Specimen`: what is measured, as far as it is there."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from semsfm_colmap.pipeline.project import Project

if TYPE_CHECKING:
    from semsfm_colmap.metrology.sizes.specimen import Specimen
    from semsfm_colmap.types import Array, TriangleMesh


def read_specimen(project: Project) -> Specimen:
    """The model of a project with its surface, labels and masks, as far as they are there."""
    from semsfm_colmap.metrology.sizes.specimen import Specimen
    from semsfm_colmap.segmentation.names import MESH_FILE

    model = project.read_main_model()
    mesh = labels = None
    names: dict[str, int] = {}
    path = project.mesh / MESH_FILE
    if path.is_file():
        from semsfm_colmap.io.ply import read_ply_mesh

        mesh = read_ply_mesh(path)
        labels, names = read_labels(project, mesh)
    return Specimen(
        model=model,
        mesh=mesh,
        frames=project.read_series().frames if project.series.is_file() else (),
        mask=mask_reader(project),
        labels=labels,
        label_names=names,
    )


def read_labels(project: Project, mesh: TriangleMesh) -> tuple[Array | None, dict[str, int]]:
    """Labels of the vertices, where they are of this very mesh; the names of the parts."""
    from numpy import array_equal

    from semsfm_colmap.io.ply import read_ply_file
    from semsfm_colmap.segmentation.files import LABEL, positions, read_table
    from semsfm_colmap.segmentation.names import MESH_FILE

    path = project.segments / MESH_FILE
    if not path.is_file():
        return None, {}
    file = read_ply_file(path)
    if LABEL not in (file.vertices.dtype.names or ()) or not array_equal(
        positions(file), mesh.vertices
    ):
        return None, {}
    parts = {part["name"]: part["label"] for part in read_table(project.segments)["parts"]}
    return file.vertices[LABEL].astype("int64"), parts


def mask_reader(project: Project) -> Callable[[str], Array | None]:
    """The mask of a prepared image by its name, None where there is none."""
    from functools import cache

    from semsfm_colmap.io.grey import read_mask

    @cache
    def mask(name: str) -> Array | None:
        return read_mask(project.masks, name)

    return mask
