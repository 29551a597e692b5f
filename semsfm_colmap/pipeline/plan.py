"""Plans: for a series to be taken, and for images to be added to a project; written when asked."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.io.atomic import file_aside
from semsfm_colmap.pipeline.project import Project

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from semsfm_colmap.planning.next_angles import MappedSeries
    from semsfm_colmap.planning.options import NoiseOptions


def read_mapped_series(
    project_path: Path, noise: NoiseOptions, *, model: int = 0
) -> tuple[MappedSeries, float | None]:
    """A model of a project as a plan takes it, and its pixel size, um, where it is known.

    Raises
    ------
    UsageError : not a folder
    InputError : not mapped, or the model is too small

    """
    from semsfm_colmap.colmap.model.sparse import read_model
    from semsfm_colmap.planning.next_angles import mapped_series

    project = Project(project_path)
    if not project.path.is_dir():
        raise UsageError(f"{project.path} is not a folder: give a project folder")
    path = project.sparse / str(model)
    if not path.is_dir():
        raise InputError(f"{path} does not exist: run `semsfm map` first")
    reconstruction = read_model(path)
    return mapped_series(reconstruction, noise), reconstruction.pixel_size_um


def write_plot(figure: Figure, path: Path) -> None:
    """Write a figure as PNG, aside, then renamed."""
    with file_aside(path, shared=True) as aside:
        figure.savefig(aside, format="png", dpi=130, metadata={"Software": None})
