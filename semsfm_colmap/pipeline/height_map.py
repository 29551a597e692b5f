"""mesh/mesh.ply -> metrology/height_map.*, areal.json: heights on a grid and what they tell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from semsfm_colmap.bounds import hold
from semsfm_colmap.errors import InputError
from semsfm_colmap.io.atomic import file_aside, write_bytes, write_json
from semsfm_colmap.metrology.heights.height_map_options import HeightMapOptions
from semsfm_colmap.metrology.heights.region import Rectangle
from semsfm_colmap.pipeline.project import Project, check_output, locked, open_project

if TYPE_CHECKING:
    from semsfm_colmap.metrology.heights.characteristics import Characteristic
    from semsfm_colmap.metrology.heights.height_map import HeightMap
    from semsfm_colmap.metrology.heights.parameter_uncertainty import ErrorModel, MeasuredParameter
    from semsfm_colmap.metrology.heights.scale_limited import Filtering, Transfer
    from semsfm_colmap.metrology.sizes.specimen import Specimen
    from semsfm_colmap.pipeline.reporter import Reporter
    from semsfm_colmap.types import Reconstruction, TriangleMesh

FORMAT = "semsfm-areal"
VERSION = 1
NAME = "height_map"
AREAL_FILE = "areal.json"
MESH_FILE = "mesh.ply"
HALVES_FILE = "half_series.ply"
SAID_OVERHANG = 0.005
"""Share of cells with surface below them that is worth a sentence; areal.json has every share."""
SAID_HOLES = 0.25
"""Share of holes that is worth a sentence: a tilted field that fills its images has 0.1."""
SAID = ("Sq", "Sa", "Sz", "Sdq", "Sdr", "Sk")
"""Parameters that are said; areal.json has all."""


def height_map(
    project_path: Path | str,
    options: HeightMapOptions | None = None,
    *,
    to: Sequence[str] = ("tif",),
    region: Rectangle | None = None,
    region_image: str | None = None,
    profile: Rectangle | None = None,
    truth_path: Path | str | None = None,
    steps: Sequence[tuple[float, float]] = (),
    reporter: Reporter | None = None,
) -> dict[str, Any]:
    """Heights of a project's surface on a grid, and its areal parameters with uncertainties.

    Writes metrology/height_map.FORMAT (levelled, unfiltered), height_map.png and areal.json;
    docs/metrology_areal.md says how.

    Parameters
    ----------
    project_path : the project folder, with a mesh
    to : formats, of `metrology.heights.files.registry`
    region : x0, y0, x1, y1 in px of an original image, as `measure` has them: what is seen there
        alone
    region_image : its name; default: the first image of the model
    profile : x0, y0, x1, y1: the ends of a line in px of the same image, for ISO 21920-2
    truth_path : folder of the rendered series, for the characteristics
    steps : (known, measured) heights, for the same
    options : grid, levelling and filters
    reporter : told how far it is, and what to note; default: nothing is said

    Returns
    -------
    the content of areal.json

    Raises
    ------
    InputError
        There is no mesh, it has no height map, or the filters ask for what it does not hold.
    UsageError
        The path is no project, or the model has no image `region_image`.

    """
    import numpy as np

    from semsfm_colmap.metrology.heights.areal import areal_parameters
    from semsfm_colmap.metrology.heights.characteristics import characteristics
    from semsfm_colmap.metrology.heights.files.registry import check_format
    from semsfm_colmap.metrology.heights.height_map import height_map_of_mesh
    from semsfm_colmap.metrology.heights.levelling import level
    from semsfm_colmap.metrology.heights.parameter_uncertainty import measured_parameters
    from semsfm_colmap.metrology.heights.picture import height_map_picture
    from semsfm_colmap.metrology.heights.scale_limited import check_filtering, scale_limited

    options = options or HeightMapOptions()
    for name, place in (("region", region), ("profile", profile)):
        hold(name, place, Rectangle | None)
    hold("steps", tuple(map(tuple, steps)), tuple[tuple[float, float], ...])
    formats = [check_format(name) for name in to]
    project = open_project(project_path)
    check_output(project, [project.metrology.name])
    with locked(project):
        specimen = specimen_with_mesh(project)
        model = specimen.model
        mesh = part_of_mesh(specimen, region, region_image)
        found = height_map_of_mesh(
            mesh,
            model.world_unit,
            right=model.cameras.cam_from_world[0, 0],
            spacing=options.spacing,
        )
        errors = errors_of(project, model, options)
        transfer = errors.transfer
        filtering = filtering_of(options, transfer)
        check_filtering(filtering, transfer, found)
        levelled = level(found, options.level, degree=options.degree).height_map
        limited = scale_limited(found, filtering, transfer)
        rng = np.random.default_rng(options.seed)
        parameters = measured_parameters(
            found, filtering, errors, areal_parameters, rng, num_draws=options.num_draws
        )
        known = characteristics(
            found,
            filtering,
            transfer,
            halves=halves_of(project, found),
            truth=None
            if truth_path is None
            else truth_map(Path(truth_path), specimen, found, region, region_image),
            steps=steps,
        )
        notes = notes_of(project, model, found)
        data = plain(found, filtering, errors, parameters, known, notes)
        if profile is not None:
            ends = profile_ends(found, specimen, profile, region_image)
            data["profile"] = profile_data(found, filtering, errors, ends, options)
        write_formats(levelled, project.metrology, formats)
        picture = height_map_picture(levelled, limited, title_of(project, filtering, found.unit))
        write_bytes(picture, project.metrology / f"{NAME}.png")
        write_json(data, project.metrology / AREAL_FILE)
    if reporter is not None:
        say(reporter, found, filtering, parameters, notes)
    return data


def write_formats(levelled: HeightMap, folder: Path, formats: Sequence[str]) -> None:
    """Write height_map.FORMAT; aside first, under a name with the ending that tells the format."""
    from semsfm_colmap.metrology.heights.files.registry import write_height_map

    folder.mkdir(exist_ok=True)
    for name in formats:
        with file_aside(folder / f"{NAME}.{name}", suffix=f".part.{name}") as aside:
            write_height_map(levelled, aside)


def errors_of(project: Project, model: Reconstruction, options: HeightMapOptions) -> ErrorModel:
    """What is known about the errors of the heights."""
    from semsfm_colmap.metrology.heights.parameter_uncertainty import ErrorModel

    return ErrorModel(
        transfer=transfer_of(project, model),
        amplification_sigma=amplification_sigma(project),
        scale_sigma=options.pixel_size_sigma if model.world_unit == "um" else 0.0,
    )


def specimen_with_mesh(project: Project) -> Specimen:
    """The model of a project and its surface."""
    from semsfm_colmap.pipeline.specimen import read_specimen

    specimen = read_specimen(project)
    if specimen.mesh is None:
        path = project.mesh / MESH_FILE
        raise InputError(f"{path} is missing: run `semsfm mesh {project.path}` first")
    return specimen


def part_of_mesh(
    specimen: Specimen, region: Rectangle | None, region_image: str | None
) -> TriangleMesh:
    """The mesh, or what a rectangle of an original image shows of it."""
    from semsfm_colmap.metrology.heights.region import part_in_rectangle

    mesh = specimen.mesh
    assert mesh is not None
    if region is None:
        return mesh
    i = image_index(specimen, region_image)
    shown = specimen.shown(i, mesh.vertices, specimen.normals)
    return part_in_rectangle(mesh, shown, specimen.model.cameras.viewing_direction[i], region)


def image_index(specimen: Specimen, name: str | None) -> int:
    """The number of an image by its name; the first one where none is given."""
    return 0 if name is None else specimen.image_named(name)


def transfer_of(project: Project, model: Reconstruction) -> Transfer:
    """What the reconstruction has filtered off, from the px of the depth maps and their windows."""
    from semsfm_colmap.config import Config, read_config
    from semsfm_colmap.metrology.heights.scale_limited import Transfer
    from semsfm_colmap.surface.half_series import fused_spacing

    config = read_config(project.config) if project.config.is_file() else Config()
    px = fused_spacing(model, config.surface) / config.surface.spacing_px
    return Transfer.of_depth_maps(px, 2 * config.surface.window_radius_px + 1)


def filtering_of(options: HeightMapOptions, transfer: Transfer) -> Filtering:
    """How the scale-limited surface is made, with the default S-filter of the reconstruction."""
    from semsfm_colmap.metrology.heights.scale_limited import Filtering

    return Filtering(
        s_index=transfer.default_s_index if options.s_filter is None else options.s_filter,
        l_index=options.l_filter,
        form=options.level,
        degree=options.degree,
        robust=options.robust,
    )


def amplification_sigma(project: Project) -> float | None:
    """Relative standard deviation of depths: that of the total rotation; None where not known."""
    from semsfm_colmap.colmap.model.sidecar import FILE_NAME, read_sidecar
    from semsfm_colmap.records import Reliability, from_plain

    said = read_sidecar(project.sparse / "0" / FILE_NAME).get("reliability")
    reliability = None if said is None else from_plain(Reliability, said)
    if reliability is None or not reliability.total_rotation_deg > 0.0:
        return None
    return reliability.total_rotation_sigma_deg / reliability.total_rotation_deg


def halves_of(project: Project, like: HeightMap) -> tuple[HeightMap, HeightMap] | None:
    """Height maps of odd and even frames where densify has made them."""
    import numpy as np

    from semsfm_colmap.io.ply import read_ply_file
    from semsfm_colmap.metrology.heights.characteristics import height_map_of_points

    path = project.dense / HALVES_FILE
    if not path.is_file():
        return None
    rows = read_ply_file(path).vertices
    points, normals = (
        np.stack([rows[name] for name in names], axis=1).astype(np.float64)
        for names in (("x", "y", "z"), ("nx", "ny", "nz"))
    )
    both = np.isfinite(rows["difference"])
    odd = points[both]
    even = odd + rows["difference"][both, None] * normals[both]
    return height_map_of_points(odd, like), height_map_of_points(even, like)


def profile_ends(
    found: HeightMap, specimen: Specimen, profile: Rectangle, image: str | None
) -> tuple[tuple[float, float], tuple[float, float]]:
    """The ends of a line, given in px of an original image, on a map."""
    import numpy as np

    from semsfm_colmap.metrology.heights.region import place_in_map

    assert found.axes is not None
    x0, y0, x1, y1 = profile
    i = image_index(specimen, image)
    cells = found.points()
    shown = specimen.shown(i, cells, np.broadcast_to(found.axes[2], cells.shape))
    scale = float(specimen.model.cameras.scale_px_per_unit[i])
    first, last = (place_in_map(found, shown, scale, xy) for xy in ((x0, y0), (x1, y1)))
    return first, last


def profile_data(
    found: HeightMap,
    filtering: Filtering,
    errors: ErrorModel,
    ends: tuple[tuple[float, float], tuple[float, float]],
    options: HeightMapOptions,
) -> dict[str, Any]:
    """Parameters of a line of the scale-limited surface: R with an L-filter, P without."""
    import numpy as np

    from semsfm_colmap.metrology.heights.parameter_uncertainty import measured_parameters
    from semsfm_colmap.metrology.heights.profile import (
        LENGTHS,
        line_profile,
        profile_parameters,
        profile_unit,
    )

    letter = "P" if filtering.l_index is None else "R"

    def parameters(limited: HeightMap) -> dict[str, float]:
        return profile_parameters(*line_profile(limited, *ends), letter=letter)

    measured = measured_parameters(
        found,
        filtering,
        errors,
        parameters,
        np.random.default_rng(options.seed),
        lengths=[letter + name for name in LENGTHS],
        num_draws=options.num_draws,
    )
    return {
        "ends": [list(end) for end in ends],
        "unit": found.unit,
        "parameters": {
            name: {
                "value": p.value if np.isfinite(p.value) else None,
                "standard_uncertainty": p.sigma if np.isfinite(p.value) else None,
                "unit": profile_unit(name, found.unit),
            }
            for name, p in measured.items()
        },
    }


def truth_map(
    path: Path,
    specimen: Specimen,
    like: HeightMap,
    region: Rectangle | None,
    region_image: str | None,
) -> HeightMap:
    """The true heights of a rendered series on the grid of a map, brought there by the cameras.

    Of the part that the region shows, where there is one: what stands over it elsewhere is not what
    was measured.

    Raises
    ------
    InputError
        There is no truth, it is of other images, or the model has the wrong hand.

    """
    import numpy as np

    from semsfm_colmap.evaluation.truth import load_truth
    from semsfm_colmap.geometry.alignment import align_cameras_both_hands
    from semsfm_colmap.metrology.heights.height_map import on_grid
    from semsfm_colmap.types import TriangleMesh

    model = specimen.model
    truth = load_truth(path)
    number = {Path(name).stem: i for i, name in enumerate(truth.names)}
    stems = [Path(name).stem for name in model.image_names]
    if truth.mesh is None or not all(stem in number for stem in stems):
        raise InputError(f"{path} is not the truth of these images: give the folder of the series.")
    true = truth.cameras.select(np.array([number[stem] for stem in stems]))
    right, wrong = align_cameras_both_hands(model.cameras, true)
    if wrong.rotation_rms_rad < right.rotation_rms_rad:
        raise InputError(
            "The model has the wrong hand, its heights are upside down: map again with "
            "--depth_sign reversed."
        )
    assert like.origin is not None
    assert like.axes is not None
    placed = right.true_from_estimated.inverse.apply(truth.mesh.vertices)
    mesh = TriangleMesh(vertices=placed, faces=truth.mesh.faces)
    mesh = part_of_mesh(replace(specimen, mesh=mesh), region, region_image)
    rows, columns = like.z.shape
    return on_grid(mesh, like.unit, like.origin, like.axes, like.spacing, (rows, columns))


def notes_of(project: Project, model: Reconstruction, found: HeightMap) -> list[str]:
    """What a reader of the numbers must know."""
    notes = []
    if model.depth_sign.status != "resolved":
        notes.append(
            "the hand of the model is not decided: the surface may be upside down, with peaks for "
            "pits (Ssk changes its sign, Sp and Sv, Spk and Svk are exchanged)"
        )
    if found.overhang_share > SAID_OVERHANG:
        notes.append(
            f"{100 * found.overhang_share:.2g} % of the cells have surface below them: the topmost "
            "one is taken"
        )
    if found.hole_share > SAID_HOLES:
        notes.append(
            f"{100 * found.hole_share:.0f} % of the map are holes: parameters of what is left may "
            "be of pieces that do not belong together; a smaller part is chosen with --region"
        )
    if model.world_unit == "px":
        notes.append("no pixel size is known: lengths are in px")
    return notes


def plain(
    found: HeightMap,
    filtering: Filtering,
    errors: ErrorModel,
    parameters: dict[str, MeasuredParameter],
    known: Sequence[Characteristic],
    notes: Sequence[str],
) -> dict[str, Any]:
    """The content of areal.json."""
    from dataclasses import asdict

    from semsfm_colmap.metrology.heights.areal import parameter_unit, undefined
    from semsfm_colmap.metrology.heights.parameter_uncertainty import SOURCES

    rows, columns = found.z.shape
    why = undefined({name: p.value for name, p in parameters.items()})
    return {
        "format": FORMAT,
        "version": VERSION,
        "unit": found.unit,
        "grid": {"columns": columns, "rows": rows, "spacing": list(found.spacing)},
        "hole_share": found.hole_share,
        "overhang_share": found.overhang_share,
        "origin": None if found.origin is None else found.origin.tolist(),
        "axes": None if found.axes is None else found.axes.tolist(),
        "filtering": asdict(filtering),
        "transfer": {**asdict(errors.transfer), "source": "rendered fields (docs/metrology_areal)"},
        "kinds": SOURCES,
        "parameters": {
            name: {
                "value": None if name in why else p.value,
                "standard_uncertainty": None if name in why else p.sigma,
                "interval_95": None if name in why else list(p.interval),
                "unit": parameter_unit(name, found.unit),
                "sources": {
                    source: "not assessed" if u is None else None if name in why else u
                    for source, u in p.sources.items()
                },
                **({"undefined": why[name]} if name in why else {}),
            }
            for name, p in parameters.items()
        },
        "characteristics": [asdict(c) for c in known],
        "notes": list(notes),
    }


def title_of(project: Project, filtering: Filtering, unit: str) -> str:
    """Name, form and filters."""
    text = f"{project.path.name}: form {filtering.form}, S-filter {filtering.s_index:.4g} {unit}"
    return text + (
        "" if filtering.l_index is None else f", L-filter {filtering.l_index:.4g} {unit}"
    )


def say(
    reporter: Reporter,
    found: HeightMap,
    filtering: Filtering,
    parameters: dict[str, MeasuredParameter],
    notes: Sequence[str],
) -> None:
    """A few lines of the result."""
    from semsfm_colmap.metrology.heights.areal import parameter_unit

    rows, columns = found.z.shape
    reporter.say(
        f"height map: {columns} x {rows} cells of {found.spacing[0]:.3g} {found.unit}, "
        f"{100 * found.hole_share:.1f} % holes, S-filter {filtering.s_index:.4g} {found.unit}"
    )
    for note in notes:
        reporter.warn(note)
    for name in SAID:
        p = parameters[name]
        line = f"  {name} {p.value:.4g} +- {p.sigma:.2g} {parameter_unit(name, found.unit)}"
        reporter.say(line.rstrip())
