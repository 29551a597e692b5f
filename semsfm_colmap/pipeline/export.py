"""Exporting a project's model with its depth maps, or a COLMAP folder's mesh, to other programs."""

from __future__ import annotations

from pathlib import Path

from semsfm_colmap.bounds import CountOrNone, hold
from semsfm_colmap.errors import InputError
from semsfm_colmap.exports.options import FormatOptions
from semsfm_colmap.exports.registry import find_format
from semsfm_colmap.exports.scene import Summary, read_scene
from semsfm_colmap.exports.write import export_mesh, export_scene
from semsfm_colmap.pipeline.foreign.mesh_colmap import RECORD, read_record
from semsfm_colmap.pipeline.outputs import command_of
from semsfm_colmap.pipeline.project import Project, open_project
from semsfm_colmap.pipeline.record import RunRecord
from semsfm_colmap.pipeline.registry import find_stage


def export_project(
    project_path: Path | str,
    format_name: str,
    output_path: Path | str | None = None,
    *,
    model: int = 0,
    options: FormatOptions | None = None,
) -> Summary:
    """Write a model of a project as another program reads it.

    Parameters
    ----------
    project_path : the project folder; for printing also what `semsfm mesh --colmap_path` wrote
    format_name : one of `semsfm_colmap.exports.registry.FORMATS`
    output_path : default PROJECT/export/<format>
    model : number of the model below sparse/
    options : focal length, names, dense settings

    Returns
    -------
    what was written and how far it is from parallel projection; the same is in export.json

    Raises
    ------
    InputError
        There is no such model, or the format cannot hold it: an image name, a missing mesh.
    UsageError
        The format is none, the path is no project, or `output_path` holds something else.

    """
    options = options or FormatOptions()
    find_format(format_name)
    hold("model", model, CountOrNone)
    project = open_project(project_path)
    model_path = project.sparse / str(model)
    if (project.path / RECORD).is_file():
        target = project.path / "export" / format_name if output_path is None else output_path
        unit = read_record(project.path).get("world_unit", "")
        return export_mesh(project.path / "mesh.ply", format_name, Path(target), options, unit)
    if not model_path.is_dir():
        raise InputError(f"{model_path} does not exist: run `semsfm map` first")
    target = project.path / "export" / format_name if output_path is None else Path(output_path)
    scene = read_scene(
        model_path,
        project.images,
        options,
        mask_path=project.masks_or_none,
        database_path=project.database,
        # depth maps and mesh are those of the first model
        depth_map_path=project.dense / "depth_maps" if model == 0 else None,
        mesh_path=project.mesh / "mesh.ply" if model == 0 else None,
        series=project.read_series() if project.series.is_file() else None,
        made=made_files(project),
    )
    return export_scene(scene, format_name, target, options)


def made_files(project: Project) -> dict[Path, str]:
    """The depth maps and masks that run.json says there are, with what makes them again."""
    record = RunRecord.read(project.record)
    made = {}
    for name, folder in (("densify", project.dense / "depth_maps"), ("ingest", project.masks)):
        command = command_of(find_stage(name), project, record)
        paths = [project.path / output for output in record.entry(name).outputs]
        made.update({path: command for path in paths if path.is_relative_to(folder)})
    return made
