"""Do measured sizes and their uncertainties hold? Shapes whose sizes are known in closed form.

Each series is a shape of `semsfm synthesize` on a plate (cap, step, pyramid, cylinder; 400 x 300 px
and 60 degrees of tilt, 20 images of the step and 10 of the others), reconstructed without options
but the direction of the tilt, and measured as a person would: places and regions in the image in
the middle. The pixel size is exact, and taken as such. Truth is what the shape was made with; a
pull is (measured - true) / u.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.tables import add_page_option, parser, put, table
from semsfm_colmap.config import Config
from semsfm_colmap.errors import InputError
from semsfm_colmap.evaluation.truth import load_truth
from semsfm_colmap.io.atomic import write_json, write_text
from semsfm_colmap.metrology.sizes.budget import Measurement
from semsfm_colmap.metrology.sizes.options import MetrologyOptions
from semsfm_colmap.pipeline.measure import measure
from semsfm_colmap.pipeline.runner import run_stages
from semsfm_colmap.synthetic.options import SceneName, SynthesizeOptions
from semsfm_colmap.synthetic.series import synthesize
from semsfm_colmap.types import Float

COMMAND = "metrology"
SCENES: tuple[SceneName, ...] = ("cap", "step", "pyramid", "cylinder")
STAGES = ("ingest", "extract", "match", "map", "densify", "mesh")
MAX_HOLE_EDGES = 200
"""Holes within the plate are closed, the border of the images is not."""
GOOD_PULL = 2.5
TWO_SIDED_95 = 1.96


@dataclass(frozen=True, kw_only=True)
class Expected:
    """A measurement and its true value, in um, um^3 or degrees."""

    name: str
    request: str
    true: float


class Picker:
    """Places of the scene in the image in the middle of a series, as a person would pick them."""

    def __init__(self, series: Path) -> None:
        self.truth = load_truth(series)
        self.middle = len(self.truth.names) // 2

    def place(self, x: float, y: float, height: float = 0.0) -> str:
        """``image:x,y`` of a point of the scene, to whole pixels, within the image."""
        point = np.array([[x, y, -height]])
        there = self.truth.cameras.project(point, np.array([self.middle]))[0]
        u, v = np.clip(there, 1.0, np.subtract(self.truth.image_size_px, 1.0))
        return f"{self.truth.names[self.middle]}:{np.floor(u) + 0.5:g},{np.floor(v) + 0.5:g}"

    def polygon(self, corners: Sequence[tuple[float, float]], height: float = 0.0) -> str:
        """A region as TOML."""
        places = ", ".join(f'"{self.place(x, y, height)}"' for x, y in corners)
        return f"{{ polygon = [{places}] }}"

    def box(self, x0: float, y0: float, x1: float, y1: float, height: float = 0.0) -> str:
        """A rectangle of the scene."""
        return self.polygon([(x0, y0), (x1, y0), (x1, y1), (x0, y1)], height)

    def rounded(self, radius: float, height: float = 0.0) -> str:
        """A circle about the middle of the scene, as a polygon."""
        angle = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
        return self.polygon(
            list(zip(radius * np.cos(angle), radius * np.sin(angle), strict=True)), height
        )


def expected(
    scene: str, facts: dict[str, Any], unit_um: float, pick: Picker
) -> tuple[str, list[Expected]]:
    """Regions as TOML lines, and what is measured of them."""
    if scene == "step":
        return of_step(facts, unit_um, pick)
    return {"cap": of_cap, "pyramid": of_pyramid, "cylinder": of_cylinder}[scene](
        facts, unit_um, pick
    )


def line(text: str, true: float, name: str) -> Expected:
    """A measurement by its TOML."""
    return Expected(name=name, request=f"{{ {text} }}", true=true)


def of_cap(facts: dict[str, Any], um: float, pick: Picker) -> tuple[str, list[Expected]]:
    """Radius, height of the top, volume above the plate, a distance and an angle on it."""
    R, h, contact = facts["radius_units"], facts["height_units"], np.radians(facts["contact_deg"])
    rim = R * np.sin(contact)
    sides = [pick.box(-1.5, -1.05, -1.12, 1.05), pick.box(1.12, -1.05, 1.5, 1.05)]
    regions = [
        f"ball = {pick.rounded(0.8 * rim, h)}",
        f"plate = {{ union = [{', '.join(sides)}] }}",
        f"around = {pick.rounded(1.08 * rim)}",
    ]
    a, b = (-0.5 * R, 0.1 * R), (0.45 * R, -0.3 * R)

    def on(x: float, y: float) -> Float:
        return np.array([x, y, np.sqrt(R**2 - x * x - y * y) - R + h])

    p, q, top = on(*a), on(*b), on(0.0, 0.0)
    return "\n".join(regions), [
        line('sphere = "ball"', R * um, "radius"),
        line(f'point_to_plane = ["{pick.place(0.0, 0.0, h)}", "plate"]', h * um, "height"),
        line('volume_above = ["around", "plate"]', facts["volume_units3"] * um**3, "volume"),
        line(
            f'distance = ["{pick.place(*a, p[2])}", "{pick.place(*b, q[2])}"]',
            float(np.linalg.norm(p - q)) * um,
            "distance",
        ),
        line(
            f'angle = ["{pick.place(*a, p[2])}", "{pick.place(0.0, 0.0, h)}", '
            f'"{pick.place(*b, q[2])}"]',
            angle_deg(p - top, q - top),
            "angle",
        ),
    ]


def of_step(facts: dict[str, Any], um: float, pick: Picker) -> tuple[str, list[Expected]]:
    """Height of the step over both sides of it, and a distance up to it."""
    h, half = facts["height_units"], facts["half_width_units"] - 0.08
    foot = facts["half_width_units"] + h / np.tan(np.radians(facts["slope_deg"])) + 0.08
    sides = [pick.box(-1.5, -1.0, -foot, 1.0), pick.box(foot, -1.0, 1.5, 1.0)]
    regions = [
        f"low = {{ union = [{', '.join(sides)}] }}",
        f"high = {pick.box(-half, -1.0, half, 1.0, h)}",
    ]
    p, q = np.array([-1.2, -0.4, 0.0]), np.array([0.2, 0.3, h])
    return "\n".join(regions), [
        line('step_height = ["low", "high"]', h * um, "height"),
        line(
            f'distance = ["{pick.place(-1.2, -0.4)}", "{pick.place(0.2, 0.3, h)}"]',
            float(np.linalg.norm(p - q)) * um,
            "distance",
        ),
    ]


def of_pyramid(facts: dict[str, Any], um: float, pick: Picker) -> tuple[str, list[Expected]]:
    """Angles between faces, volume above the plate, a distance over the top."""
    b, slope, h = facts["half_base_units"], np.radians(facts["slope_deg"]), facts["height_units"]
    low, high = 0.25 * b, 0.85 * b

    def flank(turn: int) -> str:
        corners = [(low, -0.7 * low), (high, -0.8 * high), (high, 0.8 * high), (low, 0.7 * low)]
        cosine, sine = round(np.cos(turn * np.pi / 2)), round(np.sin(turn * np.pi / 2))
        places = []
        for x, y in corners:
            where = (cosine * x - sine * y, sine * x + cosine * y)
            places.append(f'"{pick.place(*where, h - np.tan(slope) * x)}"')
        return f"{{ polygon = [{', '.join(places)}] }}"

    edge = 1.06 * b
    sides = [pick.box(-1.5, -1.05, -1.1, 1.05), pick.box(1.1, -1.05, 1.5, 1.05)]
    regions = [
        *(f"{name} = {flank(k)}" for k, name in enumerate(("right", "down", "left", "up"))),
        f"plate = {{ union = [{', '.join(sides)}] }}",
        f"around = {pick.box(-edge, -edge, edge, edge)}",
    ]
    x = 0.6 * b
    z = h - np.tan(slope) * x
    return "\n".join(regions), [
        line('plane_angle = ["left", "right"]', 2.0 * facts["slope_deg"], "angle left to right"),
        line('plane_angle = ["up", "down"]', 2.0 * facts["slope_deg"], "angle up to down"),
        line('plane_angle = ["plate", "right"]', facts["slope_deg"], "angle to the plate"),
        line('volume_above = ["around", "plate"]', facts["volume_units3"] * um**3, "volume"),
        line(
            f'distance = ["{pick.place(-x, 0.0, z)}", "{pick.place(x, 0.1, z)}"]',
            float(np.hypot(2.0 * x, 0.1)) * um,
            "distance",
        ),
    ]


def of_cylinder(facts: dict[str, Any], um: float, pick: Picker) -> tuple[str, list[Expected]]:
    """Radius, height of the ridge over the plate, a distance along the rod."""
    R, h, contact = facts["radius_units"], facts["height_units"], np.radians(facts["contact_deg"])
    half = 0.8 * R * np.sin(contact)
    edge = R * np.sin(contact)
    z = float(np.sqrt(R**2 - half**2) - R + h)
    strip = (edge + 0.08, 1.12)
    sides = [pick.box(-1.3, -strip[1], 1.3, -strip[0]), pick.box(-1.3, strip[0], 1.3, strip[1])]
    regions = [
        f"rod = {pick.box(-1.3, -half, 1.3, half, z)}",
        f"plate = {{ union = [{', '.join(sides)}] }}",
    ]
    return "\n".join(regions), [
        line('cylinder = "rod"', R * um, "radius"),
        line(f'point_to_plane = ["{pick.place(0.2, 0.0, h)}", "plate"]', h * um, "height"),
        line(
            f'distance = ["{pick.place(-1.0, 0.0, h)}", "{pick.place(0.9, 0.0, h)}"]',
            1.9 * um,
            "distance",
        ),
    ]


def angle_deg(p: Float, q: Float) -> float:
    """Between two directions."""
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(p, q)), p @ q)))


def reconstructed(home: Path, scene: SceneName, seed: int) -> None:
    """The series and its project below `home`, where they are not there yet."""
    if not (home / "series" / "truth.json").is_file():
        options = SynthesizeOptions(
            scene=scene, seed=seed, width_px=400, height_px=300, databar=False, image_format="tif"
        )
        synthesize(home / "series", options)
    config = Config()
    config = replace(
        config,
        refinement=replace(config.refinement, receding_edge="bottom"),
        surface=replace(config.surface, max_hole_edges=MAX_HOLE_EDGES),
    )
    run_stages(home / "project", config, names=STAGES, image_path=home / "series" / "images")


def one(home: Path, scene: SceneName, seed: int, *, again: bool) -> list[dict[str, Any]]:
    """Rows of a series: name, measured, true, u; read where they were made before."""
    result = home / "measured.json"
    if result.is_file() and not again:
        return list(json.loads(result.read_text()))
    reconstructed(home, scene, seed)
    truth = json.loads((home / "series" / "truth.json").read_text())
    regions, wanted = expected(scene, truth["meta"], truth["unit_um"], Picker(home / "series"))
    found = measured(home / "project", regions, wanted)
    rows = [
        {
            "scene": scene, "seed": seed, "name": item.name, "unit": got.unit, "true": item.true,
            "value": got.value, "sigma": got.sigma, "largest": got.sources[0].name,
        }
        for item in wanted
        if (got := found.get(item.name)) is not None
    ]  # fmt: skip
    write_json(rows, result)
    return rows


def measured(project: Path, regions: str, wanted: list[Expected]) -> dict[str, Measurement]:
    """What is measured, by name; a size that is refused, at a hole of the mesh, is left out."""
    asked = list(wanted)
    while asked:
        lines = ["[regions]", regions, "[measurements]"]
        lines += [f'"{item.name}" = {item.request}' for item in asked]
        write_text("\n".join(lines) + "\n", project / "measurements.toml")
        try:
            found = measure(project, options=MetrologyOptions(pixel_size_sigma=0.0))
        except InputError as error:
            print(f"{project}: refused: {error}", flush=True)
            left = [item for item in asked if not str(error).startswith(f"{item.name}:")]
            if len(left) == len(asked):
                raise
            asked = left
            continue
        return {one.name: one for one in found}
    return {}


def statistics(rows: Sequence[dict[str, Any]]) -> tuple[float, float, float]:
    """RMS of the pulls, share within the 95 % interval, largest pull."""
    pull = np.array([(row["value"] - row["true"]) / row["sigma"] for row in rows])
    within = float(np.mean(np.abs(pull) <= TWO_SIDED_95))
    return float(np.sqrt(np.mean(pull**2))), within, float(np.abs(pull).max())


def tables(rows: list[dict[str, Any]]) -> str:
    """By quantity, then all values."""
    keys = list(dict.fromkeys((row["scene"], row["name"]) for row in rows))
    summary = []
    for scene, name in keys:
        some = [row for row in rows if (row["scene"], row["name"]) == (scene, name)]
        rms, within, largest = statistics(some)
        error = np.array([row["value"] / row["true"] - 1.0 for row in some])
        sigma = float(np.median([row["sigma"] / row["true"] for row in some]))
        summary.append(
            [scene, name, len(some), f"{100 * error.mean():+.2f}", f"{100 * rms_of(error):.2f}",
             f"{100 * sigma:.2f}", f"{rms:.2f}", f"{100 * within:.0f}", f"{largest:.2f}"]
        )  # fmt: skip
    rms, within, largest = statistics(rows)
    summary.append(
        ["all", "", len(rows), "", "", "", f"{rms:.2f}", f"{100 * within:.0f}", f"{largest:.2f}"]
    )
    head = ("shape", "quantity", "series", "mean error %", "RMS error %", "u %", "RMS pull",
            "within the 95 % interval %", "largest pull")  # fmt: skip
    each = [
        [row["scene"], row["seed"], row["name"], f"{row['true']:.4f}", f"{row['value']:.4f}",
         f"{row['sigma']:.4f}", row["unit"], f"{(row['value'] - row['true']) / row['sigma']:+.2f}",
         row["largest"]]
        for row in rows
    ]  # fmt: skip
    columns = ("shape", "seed", "quantity", "true", "measured", "u", "unit", "pull", "mostly by")
    return f"{table(head, summary)}\n\nEach value:\n\n{table(columns, each)}"


def rms_of(x: Float) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(x))))


def main() -> None:
    """Render, reconstruct, measure and print; with --markdown put the tables into a page."""
    p = parser(COMMAND, __doc__)
    p.add_argument("--folder", type=Path, required=True, help="where series and projects lie")
    p.add_argument("--seeds", type=int, nargs="+", default=list(range(1, 21)))
    p.add_argument("--scenes", choices=SCENES, nargs="+", default=SCENES)
    p.add_argument("--again", action="store_true", help="measure again what was measured before")
    p.add_argument("--stored", action="store_true", help="only what lies in the folder already")
    add_page_option(p, COMMAND)
    args = p.parse_args()
    rows = []
    for scene in args.scenes:
        for seed in args.seeds:
            home = args.folder / f"{scene}_{seed}"
            if args.stored and not (home / "project" / "mesh" / "mesh.ply").is_file():
                continue
            found = one(home, scene, seed, again=args.again)
            print(json.dumps(found), flush=True)
            rows += found
    text = tables(rows)
    print(text)
    if args.markdown is not None:
        put(args.markdown, COMMAND, text)


if __name__ == "__main__":
    main()
