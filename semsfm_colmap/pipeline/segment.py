"""dense/fused.ply, mesh/mesh.ply, sparse/0 -> segments/: parts, their table, picture and masks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.io.atomic import file_aside, folder_aside, write_json
from semsfm_colmap.pipeline.project import Project, check_output, locked, open_project
from semsfm_colmap.segmentation.names import (
    CLOUD_FILE,
    MASKS,
    MESH_FILE,
    PICTURE_FILE,
    POINTS_FILE,
    SPECIMEN,
    TABLE_FILE,
    TABLE_FORMAT,
    TABLE_VERSION,
)
from semsfm_colmap.segmentation.options import SegmentationOptions

if TYPE_CHECKING:
    from semsfm_colmap.geometry.alignment import Similarity
    from semsfm_colmap.pipeline.reporter import Reporter
    from semsfm_colmap.segmentation.cuts import Cut
    from semsfm_colmap.segmentation.labels import Labelling
    from semsfm_colmap.segmentation.world import World
    from semsfm_colmap.types import Array, PointCloud, Reconstruction


def segment_project(
    project_path: Path | str,
    options: SegmentationOptions | None = None,
    *,
    new_cuts: Sequence[Cut] = (),
    undo: int = 0,
    reporter: Reporter | None = None,
) -> dict[str, Any]:
    """Label the parts of a project's surface; docs/segmentation.md says how.

    Parameters
    ----------
    project_path : the project folder, with a fused cloud
    options : of the proposal
    new_cuts : put behind those of segments.toml, and kept there
    undo : number of the last cuts of segments.toml to take back first
    reporter : told how far it is, and what to note; default: nothing is said

    Returns
    -------
    the content of segments.json

    Raises
    ------
    InputError
        When there is no cloud yet, or a cut names a part that is not there.
    UsageError
        The path is no project, or fewer cuts are there than `undo` takes back.

    """
    from semsfm_colmap.segmentation.cut_file import check_cut, read_cuts, write_cuts
    from semsfm_colmap.segmentation.cuts import Views, apply_cuts
    from semsfm_colmap.segmentation.propose import propose

    new_cuts = [check_cut(cut, "the new cut") for cut in new_cuts]
    project = open_project(project_path)
    check_output(project, [project.segments.name])
    with locked(project):
        cloud, model = read_surface(project)
        old = read_cuts(project.cuts)
        if undo > len(old):
            raise UsageError(f"{project.cuts} holds {len(old)} cuts: {undo} cannot be taken back")
        cuts = [*old[: len(old) - undo], *new_cuts]
        cuts, model_from_world, notes = in_worlds(project, model, cuts)
        labelling = propose(
            cloud, model.cameras, model.image_size_px, options or SegmentationOptions()
        )
        views = Views(names=model.image_names, cameras=model.cameras)
        labelling = apply_cuts(labelling, cloud, views, cuts, model_from_world)
        if cuts != old:
            write_cuts(cuts, project.cuts)
        return write_segments(project, cloud, model, labelling, len(cuts), notes, reporter)


def in_worlds(
    project: Project, model: Reconstruction, cuts: list[Cut]
) -> tuple[list[Cut], dict[World, Similarity], list[str]]:
    """The cuts with the world that each is in, the way from every other world to the model, notes.

    A cut that says nothing of its world, such as a new one, is in that of the model.

    Raises
    ------
    InputError
        A cut is in the coordinates of a model that cannot be brought to this one.

    """
    from semsfm_colmap.segmentation.cuts import NUM_VALUES
    from semsfm_colmap.segmentation.world import carry, world_of

    own = world_of(model.image_names, model.cameras)
    ways: dict[World, Similarity] = {}
    placed, notes = [], []
    for k, cut in enumerate(cuts):
        if cut.kind not in NUM_VALUES:
            placed.append(cut)
            continue
        placed.append(replace(cut, world=cut.world or own))
        if not cut.world or cut.world == own or cut.world in ways:
            continue
        found = carry(cut.world, model.image_names, model.cameras, model.image_size_px)
        if found.value is None:
            raise InputError(
                f"{project.cuts}: cut {k + 1} ({cut.kind}) is in the coordinates of another model "
                f"({found.message}): delete its line and make it again"
            )
        ways[cut.world] = found.value
        notes.append(
            f"the model was mapped again since cut {k + 1} was made, which is carried over: "
            f"{found.message}; look at segments.png"
        )
    return placed, ways, notes


def read_surface(project: Project) -> tuple[PointCloud, Reconstruction]:
    """The fused cloud and the model of a project."""
    from semsfm_colmap.io.ply import read_ply_cloud

    path = project.dense / CLOUD_FILE
    if not path.is_file():
        raise InputError(f"{path} is missing: run `semsfm densify {project.path}` first")
    return read_ply_cloud(path), project.read_main_model()


def write_segments(
    project: Project,
    cloud: PointCloud,
    model: Reconstruction,
    labelling: Labelling,
    num_cuts: int,
    notes: list[str],
    reporter: Reporter | None,
) -> dict[str, Any]:
    """Write PROJECT/segments as a whole and say what is in it."""
    from semsfm_colmap.geometry.normals import sampling_distance
    from semsfm_colmap.io.ply import read_ply_file, read_ply_mesh
    from semsfm_colmap.segmentation.files import positions, write_labelled
    from semsfm_colmap.segmentation.masks import part_mask
    from semsfm_colmap.segmentation.picture import draw_parts
    from semsfm_colmap.segmentation.table import parts_table
    from semsfm_colmap.segmentation.transfer import nearest_labels

    spacing = sampling_distance(cloud.points)
    with folder_aside(project.segments) as aside:
        write_labelled(
            read_ply_file(project.dense / CLOUD_FILE), labelling.label, aside / CLOUD_FILE
        )
        mesh = mesh_label = sparse_label = None
        source = project.mesh / MESH_FILE
        if source.is_file():
            mesh = read_ply_mesh(source)
            mesh_label = nearest_labels(cloud.points, labelling.label, mesh.vertices)
            write_labelled(read_ply_file(source), mesh_label, aside / MESH_FILE)
        source = project.sparse / "0" / POINTS_FILE
        if source.is_file():
            sparse = read_ply_file(source)
            sparse_label = nearest_labels(cloud.points, labelling.label, positions(sparse))
            write_labelled(sparse, sparse_label, aside / POINTS_FILE)
        specimen = labelling.label == SPECIMEN
        sizes = model.image_size_px.tolist()
        source_names = names_of_sources(project)
        for i, name in enumerate(model.image_names):
            mask = part_mask(
                cloud.points, specimen, model.cameras, i, (sizes[i][0], sizes[i][1]), spacing
            )
            for known in {name, source_names.get(name, name)}:
                write_png(mask, aside / MASKS / f"{known}.png")
        write_png(
            draw_parts(cloud, labelling, list(picture_views(model)), spacing), aside / PICTURE_FILE
        )
        table: dict[str, Any] = {
            "format": TABLE_FORMAT,
            "version": TABLE_VERSION,
            "message": labelling.message,
            "notes": notes,
            "world_unit": model.world_unit,
            "num_cuts": num_cuts,
            "parts": parts_table(labelling, mesh, mesh_label, sparse_label),
        }
        write_json(table, aside / TABLE_FILE)
    if reporter is not None:
        reporter.say(f"segments: {labelling.message}")
        for note in notes:
            reporter.warn(note)
        for part in table["parts"]:
            reporter.say(sentence(part, model.world_unit))
    return table


def names_of_sources(project: Project) -> dict[str, str]:
    """Names of the source images, by which `--masks_path` finds masks, of the prepared ones."""
    if not project.series.is_file():
        return {}
    frames = project.read_series().frames
    return {f.name: str(PurePosixPath(f.name).with_name(Path(f.source_path).name)) for f in frames}


def sentence(part: dict[str, Any], unit: str) -> str:
    """A row of the table in a line."""
    text = f"  {part['label']} {part['name']}: {part['num_points']} points"
    if part["area"] is not None:
        text += f", {part['num_faces']} faces, {part['area']:.4g} {unit}^2"
    return f"{text}, confidence {part['confidence']:.2f}"


def picture_views(model: Reconstruction) -> Array:
    """The first image's view, two more spread over the series, and one from the side: (4, 3, 3)."""
    from numpy import array, concatenate, radians

    from semsfm_colmap.geometry.rotations import rotation_from_vector

    R = model.cameras.cam_from_world
    side = rotation_from_vector(array([[0.0, radians(SIDE_DEG), 0.0]])) @ R[:1]
    return concatenate([R[[0, len(R) // 3, (2 * len(R)) // 3]], side])


SIDE_DEG = 60.0
"""The view from the side is turned by this about the upright axis of the first image."""


def write_png(pixels: Array, path: Path) -> None:
    """Write grey or RGB pixels; through memory, as OpenCV cannot write to every path."""
    from semsfm_colmap.segmentation.picture import encode_png

    with file_aside(path) as aside:
        aside.write_bytes(encode_png(pixels))
