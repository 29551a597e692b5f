"""sparse/0 and displacements -> report/goniometer.json, report/stage_moves.csv, and the report."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from semsfm_colmap.errors import InputError
from semsfm_colmap.io.atomic import write_json, write_text
from semsfm_colmap.io.csv_cells import safe_cell
from semsfm_colmap.io.layout import GONIOMETER_FILE
from semsfm_colmap.io.versions import check_version
from semsfm_colmap.pipeline.project import Project, check_output, locked, open_project
from semsfm_colmap.records import GoniometerRecord, Reliability, from_plain, to_plain

if TYPE_CHECKING:
    from semsfm_colmap.config import Config
    from semsfm_colmap.motion.goniometer import Readout
    from semsfm_colmap.pipeline.reporter import Reporter
    from semsfm_colmap.types import SemSeries

FORMAT = "semsfm-goniometer"
VERSION = 1
MOVES_FILE = "stage_moves.csv"


def measure_rotation(
    project_path: Path | str,
    *,
    displacement_path: Path | str | None = None,
    reporter: Reporter | None = None,
) -> GoniometerRecord:
    """Measure how a project's specimen was turned; docs/goniometer.md says how.

    Writes report/goniometer.json and, where a circle is told from a drift, report/stage_moves.csv;
    a report that is there is made anew.

    Parameters
    ----------
    project_path : the project folder, after map
    displacement_path : table of the series with displacements that override those recorded
    reporter : told how far it is, and what to note; default: nothing is said

    Returns
    -------
    axis, angles, wobble and, with displacements, degrees per um; the content of goniometer.json

    Raises
    ------
    InputError
        There is no model, nothing turns, or the table does not fit it.
    UsageError
        The path is no project.

    """
    from semsfm_colmap.config import Config, read_config
    from semsfm_colmap.pipeline.runner import run_stages

    project = open_project(project_path)
    table = None if displacement_path is None else Path(displacement_path)
    check_output(project, [project.report.name])
    config = read_config(project.config) if project.config.is_file() else Config()
    with locked(project):
        record = _measure(project, config, table)
        _write(record, project.report)
    if reporter is not None:
        for sentence in summary(record):
            reporter.say(sentence)
    if (project.report / "report.html").is_file():
        run_stages(project.path, config, names=("report",), reporter=reporter)
    return record


def _measure(project: Project, config: Config, displacement_path: Path | None) -> GoniometerRecord:
    import numpy as np

    from semsfm_colmap.colmap.model.sidecar import FILE_NAME, read_sidecar
    from semsfm_colmap.mapping.pose_covariance import angle_stretch, rotation_covariance
    from semsfm_colmap.motion.goniometer import Readout, measure_goniometer
    from semsfm_colmap.motion.goniometer_record import goniometer_record

    model, series = project.read_main_model(), project.read_series()
    number = {name: k for k, name in enumerate(model.image_names)}
    names = [name for name in series.names if name in number]
    images = np.array([number[name] for name in names], dtype=np.int64)
    displacement, source, notes = displacements_of(series, names, displacement_path)
    tilt = Readout(value=series.recorded("tilt_rad", names))
    said = read_sidecar(model_path(project) / FILE_NAME).get("reliability")
    reliability = None if said is None else from_plain(Reliability, said)
    covariance = rotation_covariance(model, config.refinement, reliability)
    if covariance is not None:
        rows = (3 * images[:, None] + np.arange(3)).reshape(-1)
        covariance = covariance[np.ix_(rows, rows)]
    found = measure_goniometer(
        model.cameras.select(images),
        np.asarray(model.points).mean(axis=0),
        displacement=displacement,
        tilt=tilt,
        covariance=covariance,
        stretch=angle_stretch(reliability),
    )
    if found is None:
        raise InputError(f"the specimen of {project.path} does not turn: there is no axis")
    if model.depth_sign.status != "resolved":
        notes.append(
            "the hand of the model is not decided: with the other one the specimen turns the other "
            "way, about the axis mirrored in the image plane"
        )
    return goniometer_record(
        found,
        names,
        displacement,
        tilt,
        model=model_digest(project),
        displacement_source=source,
        pixel_size_um=model.pixel_size_um,
        notes=notes,
    )


def displacements_of(
    series: SemSeries, names: Sequence[str], displacement_path: Path | None
) -> tuple[Readout, str, list[str]]:
    """Displacements of some images, from a table or as the series has them; source, remarks."""
    from semsfm_colmap.ingest.series.displacement import read_displacements
    from semsfm_colmap.motion.goniometer import Readout
    from semsfm_colmap.motion.readout import MIN_READOUTS

    notes: list[str] = []
    if displacement_path is not None:
        value, notes = read_displacements(displacement_path, names)
        source = f"table {displacement_path.name}"
    else:
        value = series.recorded("displacement_um", names)
        sources = {frame.name: frame.metadata.source for frame in series.frames}
        source = "; ".join(
            sorted({sources[name].get("displacement_um", "") for name in names} - {""})
        )
    readout = Readout(value=value)
    if len(readout.known) and not readout.differs:
        why = (
            f"only {len(readout.known)} images have one, {MIN_READOUTS} are needed"
            if len(readout.known) < MIN_READOUTS
            else "they do not differ"
        )
        notes.append(f"the displacements ({source}) give no conversion: {why}")
    return readout, source, notes


def model_path(project: Project) -> Path:
    """The folder of the model that is measured."""
    return project.sparse / "0"


def model_digest(project: Project) -> str:
    """A key of the model's cameras: whether a measurement is of this model."""
    from semsfm_colmap.colmap.model.sidecar import FILE_NAME
    from semsfm_colmap.pipeline.record import hash_file

    return hash_file(model_path(project) / FILE_NAME)


def read_goniometer(project: Project) -> GoniometerRecord | None:
    """What was measured on a project's model; None where there is nothing of this very model."""
    path = project.report / GONIOMETER_FILE
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    if not isinstance(data, dict):
        return None
    check_version(data, VERSION, path, "run `semsfm goniometer` again")
    record = from_plain(GoniometerRecord, data)
    return record if record is not None and record.model == model_digest(project) else None


def _write(record: GoniometerRecord, folder: Path) -> None:
    data: dict[str, Any] = {"format": FORMAT, "version": VERSION, **to_plain(record)}
    back = record.hysteresis_deg
    data["hysteresis_deg"] = None if back is None else to_plain(back)
    write_json(data, folder / GONIOMETER_FILE)
    moves = stage_moves(record)
    if moves:
        write_text(moves, folder / MOVES_FILE)
    else:
        (folder / MOVES_FILE).unlink(missing_ok=True)


def stage_moves(record: GoniometerRecord) -> str:
    """A CSV table of the moves of the stage, one line an image; empty where none are known."""
    out = io.StringIO()
    table = csv.writer(out, lineterminator="\n")
    unit = record.move_unit
    table.writerow(
        ["image", "displacement_um", "angle_deg", *(f"move_{axis}_{unit}" for axis in "xyz")]
    )
    for name, image in record.images.items():
        if image.move is None:
            return ""
        at = "" if image.displacement_um is None else f"{image.displacement_um:.4f}"
        moves = (f"{move:.4f}" for move in image.move)
        table.writerow([safe_cell(name), at, f"{image.angle_deg:.3f}", *moves])
    return out.getvalue()


def summary(record: GoniometerRecord) -> list[str]:
    """What to say when it is done."""
    axis = ", ".join(f"{c:.4f}" for c in record.axis_camera)
    lines = [
        f"goniometer: {record.range_deg:.2f} degrees about ({axis}) +- "
        f"{record.axis_camera_sigma_deg:.3f} degrees, wobble {record.wobble_deg_rms:.3f} degrees"
    ]
    factor, figures = record.conversion_deg_per_um, record.displacement
    if factor is not None and figures is not None:
        lines.append(
            f"{factor.value:.3f} +- {factor.sigma:.3f} degrees per um over "
            f"{figures.num_images} images, scatter {figures.scatter_deg:.3f} degrees"
        )
    if record.tilt_ratio is not None and record.tilt is not None:
        lines.append(
            f"seen over recorded tilt: {record.tilt_ratio.value:.4f} +- "
            f"{record.tilt_ratio.sigma:.4f}, repeatability {record.tilt.scatter_deg:.3f} degrees"
        )
    return [*lines, *record.notes]
