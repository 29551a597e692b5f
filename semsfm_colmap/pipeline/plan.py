"""Plans: for a series to be taken, and for images to be added to a project."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from semsfm_colmap.bounds import Count, CountOrNone, Positive, hold
from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.io.atomic import file_aside
from semsfm_colmap.pipeline.project import Project, open_project
from semsfm_colmap.planning.options import (
    GivenNoise,
    NextOptions,
    NoiseOptions,
    SpecimenOptions,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from semsfm_colmap.planning.plans import NextPlan, SeriesPlan


def plan(
    project_path: Path | str | None = None,
    *,
    depth_sigma_px: float | None = None,
    depth_sigma_um: float | None = None,
    num_frames: int | None = None,
    total_deg: float | None = None,
    step_deg: float | None = None,
    model: int = 0,
    pixel_size_um: float | None = None,
    noise: GivenNoise | None = None,
    specimen: SpecimenOptions | None = None,
    add: NextOptions | None = None,
) -> SeriesPlan | NextPlan:
    """Error bars before the images are taken (docs/plan.md).

    One of three questions: which series reach a depth sigma; what a series of `num_frames` images
    gives; which angles to add to a project. The answer has `text()`, `numbers()` and `figure()`.

    Parameters
    ----------
    project_path : a mapped project, which is only read
    depth_sigma_px, depth_sigma_um : wanted median standard deviation of the depths, by noise
    num_frames, total_deg, step_deg : of one series, with one of the two angles
    model : number of the project's model below sparse/
    pixel_size_um : for depths in um; a project knows its own
    noise : what is given goes before what the project was mapped with and its residuals show
    specimen : of a series that does not exist, and the limits of the search
    add : which images may be added to a project

    Returns
    -------
    the series that do it, or the angles to add, with their error bars

    Raises
    ------
    UsageError
        Not one question, or numbers that none can have.
    InputError
        No series does it, or the project holds no model that tells; one sentence.

    Examples
    --------
    >>> answer = plan(num_frames=7, step_deg=5.0, specimen=SpecimenOptions(specimen="field"))
    >>> answer.series[0].size.total_deg
    30.0

    """
    given, specimen, add = (
        noise or GivenNoise(),
        specimen or SpecimenOptions(),
        add or NextOptions(),
    )
    numbers = {
        "pixel_size_um": pixel_size_um,
        "depth_sigma_px": depth_sigma_px,
        "depth_sigma_um": depth_sigma_um,
        "total_deg": total_deg,
        "step_deg": step_deg,
    }
    for name, value in numbers.items():
        hold(name, value, Positive | None)
    hold("num_frames", num_frames, Count | None)
    hold("model", model, CountOrNone)
    wanted = depth_sigma_px is not None or depth_sigma_um is not None
    if sum((wanted, num_frames is not None, project_path is not None)) != 1:
        raise UsageError(
            "give one of --depth_sigma_px (or _um), --num_frames with --total_deg or --step_deg, "
            "and --project"
        )
    if project_path is not None:
        return _next_plan(Path(project_path), model, pixel_size_um, given, add)

    from semsfm_colmap.planning.plans import SeriesPlan, one_series, series_reaching, size_of

    told = given.over(NoiseOptions())
    wanted_px = _wanted_px(depth_sigma_px, depth_sigma_um, pixel_size_um)
    if wanted_px is not None:
        series = series_reaching(wanted_px, specimen, told)
    else:
        assert num_frames is not None
        series = [one_series(size_of(num_frames, total_deg, step_deg), specimen, told)]
    return SeriesPlan(
        series=tuple(series),
        wanted_px=wanted_px,
        specimen=specimen,
        noise=told,
        pixel_size_um=pixel_size_um,
    )


def _wanted_px(
    depth_sigma_px: float | None, depth_sigma_um: float | None, pixel_size_um: float | None
) -> float | None:
    """The wanted depth sigma; None where none was given."""
    if depth_sigma_um is None:
        return depth_sigma_px
    if depth_sigma_px is not None:
        raise UsageError("give --depth_sigma_px or --depth_sigma_um, not both")
    if pixel_size_um is None:
        raise UsageError("--depth_sigma_um needs the pixel size: give --pixel_size_um, too")
    return depth_sigma_um / pixel_size_um


def _next_plan(
    project_path: Path,
    model: int,
    pixel_size_um: float | None,
    given: GivenNoise,
    add: NextOptions,
) -> NextPlan:
    """Images to be added to a project."""
    from semsfm_colmap.colmap.model.sparse import read_model
    from semsfm_colmap.planning.next_angles import mapped_series, next_angles
    from semsfm_colmap.planning.plans import NextPlan

    project = open_project(project_path)
    path = project.sparse / str(model)
    if not path.is_dir():
        raise InputError(f"{path} does not exist: run `semsfm map` first")
    reconstruction = read_model(path)
    mapped = mapped_series(reconstruction, given, priors_of(project))
    return NextPlan(
        mapped=mapped,
        found=next_angles(mapped, add),
        criterion=add.criterion,
        pixel_size_um=pixel_size_um or reconstruction.pixel_size_um,
    )


def priors_of(project: Project) -> NoiseOptions:
    """What the error bars of a project's model were made with, its noise apart."""
    from semsfm_colmap.config import Config, read_config

    config = read_config(project.config) if project.config.is_file() else Config()
    options = config.refinement
    return NoiseOptions(
        scale_sigma=options.scale_sigma,
        drift_sigma_px=0.0 if options.scanned == "no" else options.drift_sigma_px,
    )


def write_plot(figure: Figure, path: Path) -> None:
    """Write a figure as PNG, aside, then renamed."""
    with file_aside(path, shared=True) as aside:
        figure.savefig(aside, format="png", dpi=130, metadata={"Software": None})
