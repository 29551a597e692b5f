"""Sizes of two real specimens with their budgets: what a page of `semsfm measure` holds.

sem_pot1, a pollen grain on a polished plate (4 images), and sem_quartz3, a quartz grain (3 images);
neither has a pixel size, so that lengths are in px. The projects are those of
``semsfm reconstruct IMAGES`` without options.
"""

from __future__ import annotations

from pathlib import Path

from benchmarks.tables import add_page_option, parser, put, table
from semsfm_colmap.io.atomic import write_text
from semsfm_colmap.metrology.sizes.budget import Measurement
from semsfm_colmap.pipeline.measure import measure
from semsfm_colmap.report.number_text import fixed, measured, number

COMMAND = "metrology_real"
NUM_SOURCES = 3
"""Lines of a budget that are shown."""
POT = """
[places]
west = "pot1_02.jpg:150,330"
east = "pot1_02.jpg:672,300"
corner = "pot1_02.jpg:344,398"
knot = "pot1_02.jpg:365,298"

[regions]
grain = { disc = "pot1_02.jpg:400,360", radius_px = 230 }
plate = { polygon = [
  "pot1_02.jpg:20,15", "pot1_02.jpg:190,15", "pot1_02.jpg:120,140", "pot1_02.jpg:20,170",
] }
cell = { disc = "pot1_02.jpg:275,435", radius_px = 40 }

[measurements]
"grain, diameter" = { sphere = "grain", diameter = true }
"grain, width" = { distance = ["west", "east"] }
"grain over the plate" = { point_to_plane = ["corner", "plate"] }
"side of a cell" = { distance = ["corner", "knot"] }
"wall over its cell" = { point_to_plane = ["corner", "cell"] }
"floor of the cell" = { area = "cell" }
"""
QUARTZ = """
[places]
west = "Quarz_02.png:130,500"
east = "Quarz_02.png:1060,700"
north = "Quarz_02.png:760,230"
south = "Quarz_02.png:580,1040"
ridge = "Quarz_02.png:808,445"

[regions]
left = { disc = "Quarz_02.png:490,760", radius_px = 60 }
middle = { disc = "Quarz_02.png:770,550", radius_px = 60 }
lower = { disc = "Quarz_02.png:770,900", radius_px = 60 }

[measurements]
"grain, length" = { distance = ["west", "east"] }
"grain, width" = { distance = ["north", "south"] }
"left to middle facet" = { plane_angle = ["left", "middle"] }
"left to lower facet" = { plane_angle = ["left", "lower"] }
"ridge over the left facet" = { point_to_plane = ["ridge", "left"] }
"left facet" = { area = "left" }
"""
REQUESTS = {"sem_pot1": POT, "sem_quartz3": QUARTZ}
HEAD = ("specimen", "size", "value", "unit", "95 % interval", "largest sources, share %")


def row(name: str, one: Measurement) -> list[str]:
    """A value in a line."""
    low, high = one.interval
    largest = "; ".join(
        f"{source.name} {fixed(100 * one.share(source), 0)}" for source in one.sources[:NUM_SOURCES]
    )
    bounds = f"{number(low, 4)} to {number(high, 4)}"
    return [name, one.name, measured(one.value, one.sigma), one.unit, bounds, largest]


def main() -> None:
    """Measure and print; with --markdown put the table into a page."""
    p = parser(COMMAND, __doc__)
    p.add_argument("--folder", type=Path, required=True, help="holds the projects by their names")
    add_page_option(p, COMMAND)
    args = p.parse_args()
    rows = []
    for name, request in REQUESTS.items():
        write_text(request, args.folder / name / "measurements.toml")
        found = measure(args.folder / name)
        rows += [row(name, one) for one in found]
    text = table(HEAD, rows)
    print(text)
    if args.markdown is not None:
        put(args.markdown, COMMAND, text)


if __name__ == "__main__":
    main()
