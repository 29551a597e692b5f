"""sparse/0, mesh/mesh.ply, measurements.toml -> metrology/: values with their budgets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from semsfm_colmap.errors import UsageError
from semsfm_colmap.io.atomic import write_json, write_text
from semsfm_colmap.metrology.sizes.options import MetrologyOptions
from semsfm_colmap.pipeline.project import Project, check_output, locked, open_project

if TYPE_CHECKING:
    from semsfm_colmap.metrology.sizes.budget import Measurement
    from semsfm_colmap.metrology.sizes.covariance import Errors
    from semsfm_colmap.metrology.sizes.requests import Requests
    from semsfm_colmap.metrology.sizes.specimen import Specimen
    from semsfm_colmap.pipeline.reporter import Reporter
    from semsfm_colmap.records import Reliability
    from semsfm_colmap.types import Reconstruction

JSON_FILE, TABLE_FILE, PAGE_FILE = "measurements.json", "measurements.csv", "measurements.html"


def measure(
    project_path: Path | str,
    *,
    points: Sequence[str] = (),
    profile: Sequence[str] = (),
    scale_from: str | None = None,
    options: MetrologyOptions | None = None,
    reporter: Reporter | None = None,
) -> list[Measurement]:
    """Measure a project's surface; docs/metrology.md says how.

    What PROJECT/measurements.toml asks for is measured, and what the arguments ask for besides.
    Writes metrology/measurements.json, .csv and .html.

    Parameters
    ----------
    project_path : the project folder, after map; regions, areas and volumes need a mesh
    points : two places, ``image:x,y`` or ``vertex:number``, for their distance; a third one for the
        angle at the second besides
    profile : the two ends of a line in one image
    scale_from : ``a,b,length[,sigma]``: a known length in um that sets the scale
    options : uncertainties of pixel size and picking
    reporter : told how far it is, and what to note; default: nothing is said

    Returns
    -------
    measurements, then checks

    Raises
    ------
    UsageError
        What is asked for makes no sense; in one sentence.
    InputError
        It is not there: no model, no mesh, no such place.

    """
    from semsfm_colmap.metrology.sizes.record import plain
    from semsfm_colmap.metrology.sizes.run import measure as measure_specimen
    from semsfm_colmap.pipeline.specimen import read_specimen

    options = options or MetrologyOptions()
    project = open_project(project_path)
    check_output(project, [project.metrology.name])
    requests = read_requests(project, points, profile, scale_from)
    with locked(project):
        specimen = read_specimen(project)
        specimen.check_one_world()
        errors = errors_of(project, specimen, options)
        found, checks = measure_specimen(specimen, errors, requests)
        notes = notes_of(specimen.model, requests)
        data = plain(specimen.model, requests, found, checks, notes)
        write(project, specimen, data)
    if reporter is not None:
        for note in notes:
            reporter.warn(note)
        for one in (*found, *checks):
            reporter.say(sentence(one))
            for remark in one.remarks:
                reporter.warn(f"{one.name}: {remark}")
        reporter.say(f"{project.metrology / PAGE_FILE} has the budgets")
    return [*found, *checks]


def read_requests(
    project: Project, points: Sequence[str], profile: Sequence[str], scale_from: str | None
) -> Requests:
    """What the file and the arguments ask for."""
    from semsfm_colmap.metrology.sizes.request_file import (
        parse_known_length,
        parse_place,
        parse_requests,
    )
    from semsfm_colmap.metrology.sizes.requests import MeasurementRequest, Requests

    asked = Requests()
    if project.measurements.is_file():
        try:
            text = project.measurements.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise UsageError(f"{project.measurements} cannot be read: {error}") from error
        asked = parse_requests(text, str(project.measurements))
    more: list[MeasurementRequest] = []
    if points:
        if len(points) not in (2, 3):
            raise UsageError(f"--points takes 2 or 3 places, not {len(points)}")
        spots = tuple(parse_place(place, "--points") for place in points)
        more.append(MeasurementRequest(name="distance", kind="distance", places=spots[:2]))
        if len(spots) == 3:
            more.append(MeasurementRequest(name="angle", kind="angle", places=spots))
    if profile:
        if len(profile) != 2:
            raise UsageError(f"--profile takes 2 places in one image, not {len(profile)}")
        ends = tuple(parse_place(place, "--profile") for place in profile)
        more.append(MeasurementRequest(name="profile", kind="profile", places=ends))
    asked = replace(asked, measurements=(*asked.measurements, *more))
    if scale_from is not None:
        asked = replace(asked, scale_from=parse_known_length(scale_from))
    if not (asked.measurements or asked.checks):
        raise UsageError(
            f"nothing to measure: give --points, or write {project.measurements} "
            "(docs/metrology.md)"
        )
    return asked


def errors_of(project: Project, specimen: Specimen, options: MetrologyOptions) -> Errors:
    """All that values of the project are uncertain by."""
    from semsfm_colmap.colmap.model.sidecar import FILE_NAME, read_sidecar
    from semsfm_colmap.config import Config, read_config
    from semsfm_colmap.mapping.joint_covariance import joint_covariance
    from semsfm_colmap.metrology.sizes.covariance import PICKING_PX, Errors, ScaleError
    from semsfm_colmap.metrology.sizes.surface_error import surface_error
    from semsfm_colmap.records import Reliability, from_plain

    model, mesh = specimen.model, specimen.mesh
    config = read_config(project.config) if project.config.is_file() else Config()
    said = read_sidecar(project.sparse / "0" / FILE_NAME).get("reliability")
    reliability = None if said is None else from_plain(Reliability, said)
    sigma = None if mesh is None else mesh.vertex_sigma
    bent = perspective_px(reliability)
    return Errors(
        cameras=joint_covariance(model, config.refinement, reliability),
        surface=None if sigma is None else surface_error(sigma, specimen.px),
        model_cameras=model.cameras,
        relief_px=None if reliability is None else reliability.relief_px,
        scale=ScaleError(sigma=options.pixel_size_sigma) if model.world_unit == "um" else None,
        unit=model.world_unit,
        picking_px=(PICKING_PX**2 + bent**2) ** 0.5,
    )


def perspective_px(reliability: Reliability | None) -> float:
    """How far the images, in which places are picked, are from the parallel model, px."""
    found = None if reliability is None else reliability.perspective
    return abs(found.deviation_px) if found is not None and found.used else 0.0


def notes_of(model: Reconstruction, requests: Requests) -> list[str]:
    """What must be known to read the values."""
    notes = []
    known = requests.scale_from
    if known is not None:
        notes.append(
            f"the scale is that of a known length: {known} is {known.length:g} um; the recorded "
            "pixel size is not used"
        )
    if model.depth_sign.status != "resolved":
        notes.append(
            "the hand of the model is not decided: with the other one heights change their sign "
            "and ridges are grooves; lengths, radii and angles stay as they are"
        )
    return notes


def write(project: Project, specimen: Specimen, data: dict[str, Any]) -> None:
    """The files of a run."""
    from semsfm_colmap.metrology.sizes.record import table
    from semsfm_colmap.report.html_measurements import measurements_page

    folder = project.metrology
    write_json(data, folder / JSON_FILE)
    write_text(table(data), folder / TABLE_FILE)
    pictures = draw(project, specimen, [*data["measurements"], *data["checks"]])
    page = measurements_page(data, project.path.resolve().name, pictures)
    write_text(page, folder / PAGE_FILE)


def draw(project: Project, specimen: Specimen, ones: Sequence[dict[str, Any]]) -> dict[str, bytes]:
    """Pictures of the images that something was picked in, by their names."""
    from semsfm_colmap.io.grey import read_grey
    from semsfm_colmap.report.figures_measurements import draw_marks, picked_images

    pictures = {}
    for name in picked_images(ones):
        own = specimen.model.image_names[specimen.image_named(name)]
        path = project.images / own
        if path.is_file():
            pictures[name] = draw_marks(read_grey(path), specimen.crop_origin(own), name, ones)
    return pictures


def sentence(one: Measurement) -> str:
    """A value in a line."""
    from semsfm_colmap.report.number_text import measured

    largest = one.sources[0].name if one.sources else "nothing assessed"
    text = f"{one.name}: {measured(one.value, one.sigma)} {one.unit} ({one.what}"
    text += f"; mostly {largest})"
    if one.check is not None:
        verdict = "agrees" if one.check.agrees else "does not agree"
        text += f"; known {one.check.length:g}: {verdict}, E_n {one.check.en:+.2f}"
    return text
