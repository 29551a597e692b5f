"""What the 3-D viewer shows of a project beside its model: texture, labels, images, errors."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from semsfm_colmap.errors import InputError, MissingDependencyError
from semsfm_colmap.metrology.sizes.options import MetrologyOptions
from semsfm_colmap.pipeline.measure import errors_of
from semsfm_colmap.pipeline.project import Project
from semsfm_colmap.pipeline.specimen import read_specimen

if TYPE_CHECKING:
    from semsfm_colmap.metrology.sizes.specimen import Specimen
    from semsfm_colmap.report.inputs import ViewerInputs
    from semsfm_colmap.types import Array, Int, TriangleMesh

TEXTURED_FILE = "mesh.glb"


def read_viewer_inputs(project: Project) -> tuple[ViewerInputs, str]:
    """For the page of a report; with a sentence where places cannot be measured in it."""
    from semsfm_colmap.metrology.sizes.page_errors import page_errors

    try:
        specimen = read_specimen(project)
        specimen.check_one_world()
    except (InputError, MissingDependencyError) as error:
        # the mesh is of another model, or there is no ray caster
        return viewer_inputs(project, None), f"the 3-D viewer measures nothing: {error}"
    found = page_errors(specimen, errors_of(project, specimen, MetrologyOptions()))
    inputs = viewer_inputs(project, specimen)
    if found is None:
        return inputs, ""
    return replace(inputs, errors=found.header, error_arrays=found.arrays), ""


def viewer_inputs(project: Project, specimen: Specimen | None) -> ViewerInputs:
    """Texture, labels and images as far as they are there; the errors are left out."""
    from semsfm_colmap.io.grey import read_grey
    from semsfm_colmap.report.inputs import ViewerInputs

    def picture(name: str) -> Array | None:
        path = project.images / name
        return read_grey(path) if path.is_file() else None

    if specimen is None or specimen.mesh is None:
        return ViewerInputs(picture=picture)
    mesh, normals = specimen.mesh, specimen.normals

    def seen(vertices: Int) -> tuple[Array, Array]:
        sees = specimen.sees(mesh.vertices[vertices], normals[vertices])
        return sees, specimen.followed(sees)

    return ViewerInputs(
        textured=read_texture(project),
        labels=specimen.labels,
        label_names=specimen.label_names,
        seen=seen if specimen.model.num_images else None,
        picture=picture,
    )


def read_texture(project: Project) -> TriangleMesh | None:
    """The textured mesh, where there is one that can be read."""
    from semsfm_colmap.surface.files import read_textured

    path = project.mesh / TEXTURED_FILE
    try:
        return read_textured(path) if path.is_file() else None
    except InputError:
        return None  # the surface is shown without it
