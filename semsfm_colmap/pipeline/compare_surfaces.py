"""mesh/mesh.ply of two projects -> difference.*, comparison.json: what has changed between them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from semsfm_colmap.bounds import Positive, hold
from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.io.atomic import folder_aside, write_bytes, write_json
from semsfm_colmap.metrology.heights.region import Rectangle
from semsfm_colmap.pipeline.project import Project, open_project

if TYPE_CHECKING:
    from semsfm_colmap.metrology.heights.comparison import SurfaceComparison, Volume
    from semsfm_colmap.pipeline.reporter import Reporter
    from semsfm_colmap.types import Reconstruction

FORMAT = "semsfm-comparison"
VERSION = 1
NAME = "difference"
COMPARISON_FILE = "comparison.json"


def compare_projects(
    before_path: Path | str,
    after_path: Path | str,
    output_path: Path | str,
    *,
    to: Sequence[str] = ("tif",),
    region: Rectangle | None = None,
    region_image: str | None = None,
    free_scale: bool = False,
    spacing: float | None = None,
    reporter: Reporter | None = None,
) -> dict[str, Any]:
    """Bring the surface of a project onto that of another and tell what has changed.

    Writes difference.FORMAT, difference.png and comparison.json into a folder of its own;
    docs/metrology_areal.md says how.

    Parameters
    ----------
    before_path, after_path : project folders with meshes, in worlds of their own
    output_path : folder of the comparison; an earlier one in it is replaced
    to : formats of the difference
    region : x0, y0, x1, y1 in px of an original image of the first project: what is seen there
    region_image : its name; default: the first image of the model
    free_scale : the scale of the second one is unknown
    spacing : of the grid of the difference, in world units; default: from the meshes
    reporter : told how far it is, and what to note; default: nothing is said

    Returns
    -------
    the content of comparison.json

    Raises
    ------
    InputError
        The units differ, the surfaces share no unchanged part, or a body is closed.
    UsageError
        A path is no project, or `output_path` holds something else.

    """
    from semsfm_colmap.metrology.heights.comparison import compare_surfaces
    from semsfm_colmap.metrology.heights.files.registry import check_format, write_height_map
    from semsfm_colmap.metrology.heights.picture import difference_picture
    from semsfm_colmap.pipeline.height_map import part_of_mesh, specimen_with_mesh, transfer_of

    hold("region", region, Rectangle | None)
    hold("spacing", spacing, Positive | None)
    formats = [check_format(name) for name in to]
    projects = [open_project(before_path), open_project(after_path)]
    output = Path(output_path)
    check_place(output)
    specimens = [specimen_with_mesh(project) for project in projects]
    models = [specimen.model for specimen in specimens]
    unit = common_unit(projects, models)
    transfer = max(
        transfer_of(project, model).nesting_index
        for project, model in zip(projects, models, strict=True)
    )
    before, after = (part_of_mesh(specimen, None, None) for specimen in specimens)
    shown = part_of_mesh(specimens[0], region, region_image)
    found = compare_surfaces(
        before, after, unit, transfer, shown=shown, with_scale=free_scale, spacing=spacing
    )
    notes = [
        f"the hand of {project.path} is not decided: if it differs from the other's, nothing agrees"
        for project, model in zip(projects, models, strict=True)
        if model.depth_sign.status != "resolved"
    ]
    data = plain(found, [str(project.path) for project in projects], notes)
    sigma = found.difference.sigma
    assert sigma is not None
    with folder_aside(output) as aside:
        for name in formats:
            write_height_map(found.difference, aside / f"{NAME}.{name}")
        title = f"{projects[0].path.name} to {projects[1].path.name}"
        picture = difference_picture(found.difference, found.significant_map, sigma, title)
        write_bytes(picture, aside / f"{NAME}.png")
        write_json(data, aside / COMPARISON_FILE)
    if reporter is not None:
        for note in notes:
            reporter.warn(note)
        say(reporter, data)
    return data


def check_place(output: Path) -> None:
    """Refuse to overwrite what is no comparison."""
    if output.exists() and not (output / COMPARISON_FILE).is_file():
        raise UsageError(f"{output} exists and is no comparison: give another --output_path")


def common_unit(
    projects: Sequence[Project], models: Sequence[Reconstruction]
) -> Literal["px", "um"]:
    """The unit of both models."""
    unit, other = (model.world_unit for model in models)
    if unit != other:
        raise InputError(
            f"{projects[0].path} is in {unit} and {projects[1].path} in {other}: give the pixel "
            "size of the one that has none and map it again."
        )
    return unit


def plain(found: SurfaceComparison, paths: Sequence[str], notes: Sequence[str]) -> dict[str, Any]:
    """The content of comparison.json."""
    motion = found.registration.fixed_from_moving
    unit = found.difference.unit
    rows, columns = found.difference.z.shape
    assert found.difference.origin is not None
    assert found.difference.axes is not None

    def volume(of: Volume) -> dict[str, Any]:
        return {
            "value": of.value,
            "sigma": of.sigma if of.area > 0.0 else None,
            "unit": f"{unit}^3",
            "area": of.area,
            "area_unit": f"{unit}^2",
        }

    return {
        "format": FORMAT,
        "version": VERSION,
        "before": paths[0],
        "after": paths[1],
        "unit": unit,
        "grid": {"columns": columns, "rows": rows, "spacing": list(found.difference.spacing)},
        "origin": found.difference.origin.tolist(),
        "axes": found.difference.axes.tolist(),
        "before_from_after": {
            "rotation": motion.rotation.tolist(),
            "scale": motion.scale,
            "scale_sigma": found.registration.scale_sigma,
            "shift": motion.shift.tolist(),
        },
        "unchanged_share": found.registration.unchanged_share,
        "error_scale": found.registration.error_scale,
        "least_depth": found.least_depth,
        "volume_lost": volume(found.lost),
        "volume_gained": volume(found.gained),
        "volume_net": volume(found.net),
        "notes": list(notes),
    }


def say(reporter: Reporter, data: dict[str, Any]) -> None:
    """A few lines of the result."""
    reporter.say(
        f"compare: {100 * data['unchanged_share']:.0f} % of the surfaces agree within their error "
        f"bars, which they differ by {data['error_scale']:.2f} of"
    )
    for what in ("lost", "gained", "net"):
        v = data[f"volume_{what}"]
        if v["sigma"] is None:
            reporter.say(
                f"  volume {what}: no place differs by more than the {data['least_depth']:.2g} "
                f"{data['unit']} that errors make"
            )
            continue
        reporter.say(
            f"  volume {what} {v['value']:.4g} +- {v['sigma']:.2g} {v['unit']} on {v['area']:.3g} "
            f"{v['area_unit']}"
        )
