"""Any COLMAP folder -> a mesh beside it: perspective or parallel, sparse or dense.

Which cloud is meshed, `mesh_source.py` says. The folder is only read.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.io.atomic import folder_aside, write_json
from semsfm_colmap.io.versions import check_version
from semsfm_colmap.pipeline.foreign.mesh_source import all_there, parallel_model, read_source
from semsfm_colmap.pipeline.foreign.workspace import find_workspace
from semsfm_colmap.pipeline.reporter import Reporter
from semsfm_colmap.records import ForeignMeshRecord, known_only
from semsfm_colmap.surface.options import SurfaceOptions

FOLDER = "mesh_semsfm"
"""Default name of the result in the COLMAP folder."""
RECORD = "mesh.json"
"""Marks a result of ours, which may be replaced."""
FORMAT = "semsfm-mesh"
VERSION = 1
EITHER_HAND = (
    "the projection is parallel, and no reprojection error tells the surface from its "
    "depth-reversed twin: look whether hills came out as valleys"
)


def mesh_colmap(
    colmap_path: Path | str,
    output_path: Path | str | None = None,
    *,
    sparse_path: Path | str | None = None,
    image_path: Path | str | None = None,
    options: SurfaceOptions | None = None,
    reporter: Reporter | None = None,
) -> ForeignMeshRecord:
    """Mesh a COLMAP folder into ``mesh.ply`` and ``cloud.ply``.

    Where the projection is parallel and all images are there, ``mesh.glb`` and ``mesh.obj`` have
    their texture.

    Parameters
    ----------
    colmap_path : a workspace, a dense workspace, a folder of models or a model; it is only read
    output_path : default COLMAP_PATH/mesh_semsfm; an earlier result of ours in it is replaced
    sparse_path : the model, where it is not found or another component is wanted
    image_path : the images, where they are not in images/
    options : method and lengths
    reporter : told how far it is, and what to note; default: nothing is said

    Returns
    -------
    the same as in mesh.json: where the cloud came from, what the mesh is like

    Raises
    ------
    InputError
        There is no model in the folder, or no surface comes of it.
    MissingDependencyError
        open3d, which meshes, is not there.
    UsageError
        A path is no folder, or `output_path` holds something else.

    """
    from semsfm_colmap.io.open3d_library import import_open3d
    from semsfm_colmap.io.ply import write_ply
    from semsfm_colmap.pipeline.texture import write_texture
    from semsfm_colmap.surface.build import mesh, mesh_record

    import_open3d()
    options, reporter = options or SurfaceOptions(), reporter or Reporter(verbosity=-1)
    colmap_path = Path(colmap_path)
    target = colmap_path / FOLDER if output_path is None else Path(output_path)
    workspace = find_workspace(
        colmap_path,
        None if sparse_path is None else Path(sparse_path),
        None if image_path is None else Path(image_path),
    )
    check_target(target)
    for other in workspace.other_models:
        reporter.detail(f"{other} is another component: --sparse_path meshes it")
    parallel = parallel_model(workspace)
    source = read_source(workspace, parallel, options, reporter)
    notes = source.notes
    if parallel is not None and parallel.depth_sign.status == "ambiguous":
        notes += (EITHER_HAND,)
    reporter.say(f"{workspace.model_path}: {len(source.cloud.points)} points, {source.kind}")
    reporter.say(f"sigma of the vertices: {source.sigma}")
    solution = mesh(source.cloud, options, source.views)
    if solution.value is None:
        raise InputError(f"{workspace.model_path}: {solution.message}")
    try:
        with folder_aside(target) as aside:
            write_ply(aside / "mesh.ply", solution.value)
            write_ply(aside / "cloud.ply", source.cloud)
            images = workspace.image_path
            if parallel is not None and images is not None and all_there(images, parallel):
                notes += write_texture(solution.value, parallel, images, aside, options)
            record = ForeignMeshRecord(
                model_path=str(workspace.model_path),
                source=source.kind,
                sigma=source.sigma,
                num_points=len(source.cloud.points),
                mesh=mesh_record(solution.value, options.method, notes),
                world_unit="um" if parallel is not None and parallel.world_unit == "um" else "",
            )
            head = {"format": FORMAT, "version": VERSION}
            write_json({**head, **known_only(record)}, aside / RECORD)
    except OSError as error:
        raise UsageError(
            f"{target} cannot be written ({error.strerror}): give another --output_path"
        ) from error
    for note in notes:
        reporter.warn(note)
    return record


def read_record(folder: Path) -> dict[str, Any]:
    """What mesh.json says.

    Raises
    ------
    InputError
        It cannot be read.

    """
    path = folder / RECORD
    try:
        content: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise InputError(
            f"{path} cannot be read ({error}): run `semsfm mesh --colmap_path` again"
        ) from error
    # the first ones said no version
    again = "run `semsfm mesh --colmap_path` again"
    check_version({"version": 1, **content}, VERSION, path, again)
    return content


def check_target(target: Path) -> None:
    """Refuse a place that holds anything but a mesh of ours."""
    if target.exists() and not target.is_dir():
        raise UsageError(f"{target} is a file: give a folder as --output_path")
    if target.is_dir() and any(target.iterdir()) and not (target / RECORD).is_file():
        raise UsageError(
            f"{target} holds files that `semsfm mesh --colmap_path` did not write: give another "
            "--output_path, so that nothing is overwritten"
        )
