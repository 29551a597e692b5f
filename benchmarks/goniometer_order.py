"""What displacements do to a belt whose images are shuffled, and to its angles as a prior.

One rendered belt (`benchmarks.goniometer`), its images in order and under shuffled names; with its
displacements, without them, and with wrong ones; no guided pass. Rotation errors are what is left
after a common rotation of the world.
"""

from __future__ import annotations

import shutil
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks import tables
from benchmarks.goniometer import BELTS, STAGES, Belt, read_table, rendered
from semsfm_colmap.colmap.model.sparse import read_model
from semsfm_colmap.config import Config
from semsfm_colmap.evaluation.truth import Truth, load_truth
from semsfm_colmap.geometry.alignment import align_rotations
from semsfm_colmap.geometry.rotations import depth_reversed, rotation_angle
from semsfm_colmap.pipeline.goniometer import measure_rotation
from semsfm_colmap.pipeline.runner import run_stages

BELT = BELTS[0]
SEED = 1
FIRST = "case_0"
HEAD = (
    "series",
    "displacements",
    "images",
    "neighbours out of order",
    "rotations deg (median)",
    "what is said of displacements",
)


@dataclass(frozen=True, kw_only=True)
class Case:
    """One way to give the same images."""

    name: str
    displacements: str
    shuffled: bool = False
    given: bool = True
    exhaustive: bool = False
    factor: float | None = None
    """calibrated, as a share of the true one"""
    wrong: float = 0.0
    """relative standard deviation of each displacement"""


CASES = (
    Case(name="in order", displacements="none", given=False),
    Case(name="in order", displacements="right"),
    Case(name="in order", displacements="right, factor known", factor=1.0),
    Case(name="in order", displacements="right, factor 10 % too large", factor=1.1),
    Case(name="in order", displacements="each wrong by 10 %", wrong=0.1),
    Case(name="shuffled", displacements="right", shuffled=True),
    Case(name="shuffled", displacements="none, all pairs", shuffled=True, given=False,
         exhaustive=True),
)  # fmt: skip


def write_series(case: Case, home: Path, folder: Path) -> dict[str, str]:
    """Images under the names of a case and their table; the true name of each."""
    shutil.rmtree(folder, ignore_errors=True)
    (folder / "images").mkdir(parents=True)
    rng = np.random.default_rng(SEED)
    said = read_table(home / "displacement.csv")
    true = sorted(said)
    place = rng.permutation(len(true)) if case.shuffled else np.arange(len(true))
    names = {f"image_{place[k]:03d}.png": name for k, name in enumerate(true)}
    lines = ["image,displacement_um"]
    for name, source in sorted(names.items()):
        shutil.copy(home / "images" / source, folder / "images" / name)
        lines.append(f"{name},{said[source] * (1.0 + case.wrong * rng.normal()):.5f}")
    (folder / "displacement.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return names


def config_of(case: Case, folder: Path, belt: Belt) -> Config:
    """The options that a person would give."""
    config = Config()
    factor = None if case.factor is None else case.factor * belt.degrees_per_um
    ingest = replace(
        config.ingest,
        series_csv=folder / "displacement.csv" if case.given else None,
        degrees_per_um=factor,
    )
    matching = replace(config.matching, pairs="exhaustive" if case.exhaustive else "auto")
    guided = replace(config.guided, enabled=False)
    return replace(config, ingest=ingest, matching=matching, guided=guided)


def median_error_deg(project: Path, names: dict[str, str], truth: Truth) -> float:
    """Of the rotations, in the hand that fits."""
    model = read_model(project / "sparse" / "0")
    rows = [truth.names.index(names[name]) for name in model.image_names]
    R, true = np.asarray(model.cameras.cam_from_world), truth.cameras.cam_from_world[rows]
    hands = []
    for hand in (R, depth_reversed(R)):
        left = rotation_angle(hand @ align_rotations(hand, true) @ true.transpose(0, 2, 1))
        hands.append(float(np.rad2deg(np.median(left))))
    return min(hands)


def out_of_order(order: tuple[str, ...], names: dict[str, str]) -> int:
    """Neighbours in the order found that are none in truth, the seam of the turn apart."""
    number = {name: k for k, name in enumerate(sorted(names.values()))}
    places = np.array([number[names[name]] for name in order])
    apart = np.abs(np.diff(places))
    return int(np.sum(np.minimum(apart, len(names) - apart) != 1))


def row(case: Case, home: Path, folder: Path) -> list[object]:
    """One row of the table."""
    names = write_series(case, home, folder)
    project = folder / "project"
    if not case.shuffled and folder.name != FIRST:
        # the same pixels: their features need not be found again
        shutil.copytree(folder.parent / FIRST / "project", project)
    config = config_of(case, folder, BELT)
    record = run_stages(project, config, names=STAGES, image_path=folder / "images")
    said = [note for note in record.notes() if "displacement" in note or "known tilt" in note]
    found = measure_rotation(project)
    return [
        case.name,
        case.displacements,
        f"{len(found.images)} / {len(names)}",
        out_of_order(found.order, names),
        f"{median_error_deg(project, names, load_truth(home)):.4f}",
        "; ".join(said) or "-",
    ]


def main() -> None:
    """Map all cases and print."""
    parser = tables.parser("goniometer_order", __doc__)
    tables.add_page_option(parser, "goniometer_order")
    parser.add_argument("folder", type=Path, help="for the rendered belts; reused where they are")
    parser.add_argument("--spore", type=Path, help="a whole turn with truth, shuffled as well")
    arguments = parser.parse_args()
    home = rendered(BELT, arguments.folder)
    rows = []
    for k, case in enumerate(CASES):
        rows.append(row(case, home, arguments.folder / f"case_{k}"))
        print(tables.line(rows[-1]), flush=True)
    if arguments.spore is not None:
        case = replace(CASES[-1], name="synth_spore, shuffled")
        rows.append(row(case, arguments.spore, arguments.folder / "spore"))
        print(tables.line(rows[-1]), flush=True)
    if arguments.markdown is not None:
        tables.put(arguments.markdown, "goniometer_order", tables.table(HEAD, rows))


if __name__ == "__main__":
    main()
