"""The numbers of the paper beside ours, from finished projects.

The projects are those of `semsfm reconstruct` with default options on series like the paper's
three: a field tilted over 60 degrees, a pollen grain over 180, spores on a helical belt through a
full turn (`semsfm goniometer` has run on the last). The study of detectors is that of
docs/features. `scripts/paper_figures.py` calls this and draws the figures besides.
"""

from __future__ import annotations

import argparse
import csv
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import tables

STUDY = Path("docs/features/synth_pollen")
COMMANDS = ("paper --only numbers", "paper --only detectors")
BELT_DEG_PER_UM = 171.3
HARRIS_HESSIAN = "harris-hessian-laplace"
PAPER_DETECTORS = (
    "harris-affine", "harris-laplace", "hessian-affine", "hessian-laplace", HARRIS_HESSIAN,
    "edge-laplace",
)  # fmt: skip
PAPER_DESCRIPTORS = ("sift", "gloh", "cc", "steerable", "differential")
PAPER_OVERLAP = {
    ("harris-laplace", "harris-affine"): 69,
    ("hessian-affine", "harris-affine"): 1,
    ("hessian-affine", "harris-laplace"): 0,
    ("hessian-laplace", "harris-affine"): 0,
    ("hessian-laplace", "harris-laplace"): 1,
    ("hessian-laplace", "hessian-affine"): 58,
    (HARRIS_HESSIAN, "harris-affine"): 37,
    (HARRIS_HESSIAN, "harris-laplace"): 39,
    (HARRIS_HESSIAN, "hessian-affine"): 15,
    (HARRIS_HESSIAN, "hessian-laplace"): 16,
}
"""Table 1 of the paper, percent."""


@dataclass(frozen=True, kw_only=True)
class Project:
    """A finished project: its numbers, and where its figures are."""

    path: Path
    metrics: dict[str, Any]

    @classmethod
    def read(cls, path: Path) -> Project:
        """Read report/metrics.json."""
        text = (path / "report/metrics.json").read_text(encoding="utf-8")
        return cls(path=path, metrics=json.loads(text))

    def __getitem__(self, keys: str) -> Any:
        """A number by its keys, joined by dots."""
        found: Any = self.metrics
        for key in keys.split("."):
            found = found[key]
        return found

    @property
    def frames(self) -> str:
        """Registered of given images."""
        return f"{self['images.num_registered']} of {self['images.num_given']}"

    @property
    def goniometer(self) -> dict[str, Any]:
        """What `semsfm goniometer` wrote."""
        text = (self.path / "report/goniometer.json").read_text(encoding="utf-8")
        record: dict[str, Any] = json.loads(text)
        return record


@dataclass(frozen=True, kw_only=True)
class Row:
    """A number of the paper, ours, and why they differ."""

    where: str
    what: str
    paper: str
    ours: str
    why: str


def thresholds(project: Project) -> str:
    """The rounds of filtering."""
    return ", ".join(f"{one['threshold_px']:.3g}" for one in project["filtering_rounds"])


def size_rows(nickel: Project, pollen: Project, spore: Project) -> list[Row]:
    """Series, rounds, residuals, points."""
    return [
        Row(
            where="figures 9 to 11",
            what="series",
            paper="tilted nickel; a pollen grain over 180°; a mold spore through 360°; up to "
            "100 frames",
            ours=f"nickel {nickel.frames} over {nickel['rotation.range_deg']:.1f}°, pollen "
            f"{pollen.frames} over {pollen['rotation.range_deg']:.1f}°, spores {spore.frames} over "
            f"{spore['rotation.range_deg']:.1f}°",
            why="the paper's images are not published: ours are rendered after its figures, with "
            "exact truth. 1000 frames of simulated tracks take 37 s "
            "([size](benchmark_geometry.md#size))",
        ),
        Row(
            where="text, p. 132",
            what="filtering",
            paper="8 px to 1 px over four rounds",
            ours=f"pollen: {thresholds(pollen)} px",
            why="the same schedule, but no round filters below three robust standard deviations of "
            "the residuals, where right observations would go; one more round ends there",
        ),
        Row(
            where="text, p. 132",
            what="points of the pollen",
            paper="21 153",
            ours=f"{pollen['structure.num_points']}",
            why="ours are those seen by three images or more, "
            f"{pollen['structure.mean_track_length']:.1f} on the average; two views of a point "
            "check nothing. The dense cloud has "
            f"{pollen['cloud.num_points']} points, which the paper leaves to future work",
        ),
        Row(
            where="text, p. 132",
            what="points of the spore",
            paper="36 656",
            ours=f"{spore['structure.num_points']}",
            why=f"the same; seen by {spore['structure.mean_track_length']:.1f} images on the "
            f"average, dense cloud {spore['cloud.num_points']} points. The belt is in ours, too",
        ),
    ]


def residual_rows(nickel: Project, pollen: Project, pixel_nm: float | None) -> list[Row]:
    """Figure 15."""

    def nm(key: str) -> str:
        return "" if pixel_nm is None else f" ({pollen[key] * pixel_nm:.1f} nm)"

    x, y = (f"residuals.sigma_{axis}_px" for axis in "xy")
    return [
        Row(
            where="figure 15",
            what="residuals of the pollen, along x",
            paper="σ = 0.33 px (13.4 nm), mean 0.00",
            ours=f"σ = {pollen[x]:.2f} px{nm(x)}, mean {abs(pollen['residuals.mean_x_px']):.2f}",
            why="the guided pass aligns every observation to its reference patch; from matched "
            "keypoints alone it is 0.34 px ([guided](guided.md#what-was-measured))",
        ),
        Row(
            where="figure 15",
            what="along y",
            paper="σ = 0.59 px (23.8 nm), mean 0.00",
            ours=f"σ = {pollen[y]:.2f} px{nm(y)}, mean {abs(pollen['residuals.mean_y_px']):.2f}",
            why="rows are scanned one after the other: drift within a frame widens y. Here it is "
            f"estimated and taken out. Nickel: {nickel[x]:.2f} and {nickel[y]:.2f} px",
        ),
    ]


def motion_rows(pollen: Project, spore: Project) -> list[Row]:
    """Figures 1, 7, 14, 16, 17."""
    matched = [
        one["num_verified_matches_to_next"]
        for one in pollen["per_image"]
        if one["num_verified_matches_to_next"]
    ]
    conversion = spore.goniometer["conversion_deg_per_um"]
    belt = f"{conversion['value']:.2f} ± {conversion['sigma']:.2f} °/µm"
    pull = (conversion["value"] - BELT_DEG_PER_UM) / conversion["sigma"]
    lengths = np.array(pollen["structure.track_length_counts"])
    return [
        Row(
            where="figure 1",
            what="visibility matrix of the pollen",
            paper="a band",
            ours=f"a band; the longest track has {int(np.flatnonzero(lengths)[-1])} images",
            why="below: the guided pass fills the band",
        ),
        Row(
            where="figure 14",
            what="matched points by frame",
            paper="a curve over the frames of the pollen",
            ours=f"{min(matched)} to {max(matched)} with the next frame (median "
            f"{int(np.median(matched))}), verified",
            why="COLMAP's SIFT, upright, in place of Harris-Hessian-Laplace; other images",
        ),
        Row(
            where="figure 7, text",
            what="rotation by displacement of the belt",
            paper="linear, 171.3 °/µm",
            ours=belt,
            why="the rendered belt has the paper's 171.3, read to 1 nm: a difference of "
            f"{pull:+.1f} sigma ([goniometer](goniometer.md))",
        ),
        Row(
            where="figures 16, 17",
            what="camera trajectories",
            paper="a half and a full turn, distance arbitrary; no error is given",
            ours=f"{pollen['rotation.range_deg']:.2f} ± "
            f"{pollen['reliability.total_rotation_sigma_deg']:.2f}°, "
            f"{spore['rotation.range_deg']:.2f} ± "
            f"{spore['reliability.total_rotation_sigma_deg']:.2f}°",
            why="true rotations to 0.055 and 0.027° (median over images, [against "
            "COLMAP](benchmark_vs_colmap.md)); parts of the error bars in [truth](truth.md)",
        ),
        Row(
            where="-",
            what="hand (depth reversal)",
            paper="not mentioned",
            ours=f"pollen {pollen['depth_sign.status']} "
            f"({pollen['depth_sign.confidence']:.4f}), spores {spore['depth_sign.status']} "
            f"({spore['depth_sign.confidence']:.4f})",
            why="no residual tells it: [depth reversal](depth_reversal.md)",
        ),
    ]


def surface_rows(nickel: Project, pollen: Project, spore: Project) -> list[Row]:
    """Figures 18, 19, and the spore that could not be meshed."""

    def mesh(project: Project) -> str:
        share = 100.0 * project["mesh.largest_component_area_fraction"]
        return (
            f"{project['mesh.num_faces']} faces, {project['mesh.num_components']} pieces, "
            f"{share:.1f} % of the area in the largest"
        )

    return [
        Row(
            where="figure 18",
            what="surface of the nickel, textured",
            paper="ball pivoting in MeshLab of the sparse points",
            ours=mesh(nickel),
            why="ball pivoting of the fused depth maps; texture of all images without shading",
        ),
        Row(
            where="figure 19",
            what="surface of the pollen",
            paper="the same",
            ours=mesh(pollen),
            why="0.71 px from the true surface in the median, 86 % of what three images see within "
            "2 px ([completeness](surface_completeness.md))",
        ),
        Row(
            where="text, p. 132",
            what="surface of the spore",
            paper="none: too complex for the meshing tool",
            ours=mesh(spore),
            why="dense stereo gives the points that ball pivoting needs, as the paper foresaw; "
            "0.82 px, 85 %",
        ),
        Row(
            where="text, p. 132",
            what="coil cut from the specimen",
            paper="by hand",
            ours="proposed by `semsfm segment`, cuts by hand on top",
            why="[segmentation](segmentation.md)",
        ),
    ]


def comparison(rows: list[Row]) -> str:
    """The rows as a table."""
    cells = [(row.where, row.what, row.paper, row.ours, row.why) for row in rows]
    return tables.table(("in the paper", "what", "paper", "here", "why they differ"), cells)


def read_csv(path: Path) -> list[dict[str, str]]:
    """The rows of a table of the feature study."""
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def detector_tables(study: Path) -> str:
    """Figures 12 and 13 and table 1 as numbers."""
    counts = {(r["detector"], r["descriptor"]): r for r in read_csv(study / "figure12.csv")}

    def kept(detector: str, descriptor: str) -> str:
        row = counts[detector, descriptor]
        names = ("matched", "heuristically_filtered", "robustly_filtered")
        return " / ".join(f"{float(row[name]):.0f}" for name in names)

    twelve = tables.table(
        ("", *PAPER_DESCRIPTORS),
        [(det, *(kept(det, desc) for desc in PAPER_DESCRIPTORS)) for det in PAPER_DETECTORS],
    )
    frames = read_csv(study / "figure13.csv")
    thirteen = tables.table(
        PAPER_DETECTORS,
        [[f"{np.mean([float(r[name]) for r in frames]):.0f}" for name in PAPER_DETECTORS]],
    )
    overlap = {row["percent"]: row for row in read_csv(study / "table1.csv")}
    columns = PAPER_DETECTORS[:4]

    def both(row: str, column: str) -> str:
        paper = PAPER_OVERLAP.get((row, column))
        return "" if paper is None else f"{paper} / {float(overlap[row][column]):.0f}"

    one = tables.table(
        ("paper / here, %", *columns),
        [(row, *(both(row, column) for column in columns)) for row in PAPER_DETECTORS[1:5]],
    )
    return "\n\n".join(
        [
            "Figure 12, matches of consecutive images: matched / heuristically / robustly kept.",
            twelve,
            "Figure 13, matched points by detector with SIFT, mean over the frames.",
            thirteen,
            "Table 1, overlap of detectors.",
            one,
        ]
    )


def add_project_options(parser: argparse.ArgumentParser) -> None:
    """The projects and what is known of them."""
    for name in ("nickel", "pollen", "spore"):
        parser.add_argument(f"--{name}", type=Path, required=True, metavar="PROJECT")
    parser.add_argument("--pollen_pixel_nm", type=float, help="size of a pixel of the pollen")
    parser.add_argument("--study", type=Path, default=STUDY, help="folder of compare-features")


def all_tables(given: argparse.Namespace) -> dict[str, str]:
    """The tables by the commands that make them."""
    nickel, pollen, spore = (Project.read(p) for p in (given.nickel, given.pollen, given.spore))
    rows = [
        *size_rows(nickel, pollen, spore),
        *residual_rows(nickel, pollen, given.pollen_pixel_nm),
        *motion_rows(pollen, spore),
        *surface_rows(nickel, pollen, spore),
    ]
    return dict(zip(COMMANDS, (comparison(rows), detector_tables(given.study)), strict=True))


def main() -> None:
    """Print the tables, or put them into a page."""
    parser = tables.parser("paper", __doc__)
    parser.add_argument("--only", choices=("numbers", "detectors"), help="one of the two")
    add_project_options(parser)
    tables.add_page_option(parser, *COMMANDS)
    given = parser.parse_args()
    for command, text in all_tables(given).items():
        if given.only not in (None, command.split()[-1]):
            continue
        if given.markdown is None:
            print(text)
        else:
            tables.put(given.markdown, command, text)


if __name__ == "__main__":
    main()
