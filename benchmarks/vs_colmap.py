"""Our pipeline and COLMAP's, side by side on the same images in one run.

A SERIES is a folder with images/ and, for the errors, truth.json. COLMAP runs through pycolmap on
the same prepared images (databar cut off), twice:

defaults   extract_features, match_sequential (overlap 10) and incremental_mapping as they come
expert     a fixed focal length of 1e5 px (all but parallel), the filter on focal lengths raised,
           no normalisation by camera centres: the best set-up known for parallel projection

Rotation errors are medians after the best common rotation, for the hand that fits better; "hand"
says whether that is the hand the program gave. Times are wall-clock seconds, processor seconds
those of all threads, both medians over `--runs` of each program in turn: compare rows of one run,
never runs.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import tables
from benchmarks.profile import cpu_seconds
from semsfm_colmap.colmap.library import pycolmap
from semsfm_colmap.colmap.model.sparse import read_model
from semsfm_colmap.config import Config
from semsfm_colmap.evaluation.truth import load_truth
from semsfm_colmap.geometry.rotations import depth_reversed, nearest_rotation, rotation_angle
from semsfm_colmap.pipeline.runner import run_stages

EXPERT_FOCAL_PX = 1e5
OVERLAP = 10
HEAD = (
    "series",
    "program",
    "images",
    "rotation error (median)",
    "hand",
    "residual px",
    "points",
    "extract s",
    "match s",
    "map s",
    "images to sparse s",
    "CPU s",
    "times as long as ours",
)


@dataclass
class Row:
    """One program on one series."""

    series: str
    program: str
    num_images: int = 0
    registered: int = 0
    error_deg: float = float("nan")
    hand: str = "-"
    rms_px: float = float("nan")
    num_points: int = 0
    seconds: dict[str, float] = field(default_factory=dict)
    cpu_s: float = float("nan")

    @property
    def total_s(self) -> float:
        """From images to a sparse model."""
        return sum(self.seconds.values()) if self.seconds else float("nan")


def timed(run: Callable[[], Row]) -> Row:
    """The row of a run with its processor seconds."""
    before = cpu_seconds()
    row = run()
    return replace(row, cpu_s=cpu_seconds() - before)


def median_row(rows: list[Row]) -> Row:
    """The run in the middle by its time, with the medians of all times and of the error."""
    middle = sorted(rows, key=lambda row: row.total_s)[len(rows) // 2]
    return replace(
        middle,
        seconds={k: float(np.median([row.seconds[k] for row in rows])) for k in middle.seconds},
        cpu_s=float(np.median([row.cpu_s for row in rows])),
        error_deg=float(np.median([row.error_deg for row in rows])),
    )


def compare_rotations(names: list[str], R: Any, series: Path) -> tuple[float, str]:
    """Median rotation error of the better hand and which hand that is."""
    if not (series / "truth.json").is_file() or len(names) < 3:
        return float("nan"), "-"
    truth = load_truth(series)
    number = {Path(n).stem: k for k, n in enumerate(truth.names)}
    rows = [number[Path(n).stem] for n in names]
    R_true = np.asarray(truth.cameras.cam_from_world)[rows]
    errors = {}
    for hand, candidate in (("right", R), ("reversed", depth_reversed(R))):
        Q = nearest_rotation(np.einsum("mji,mjk->ik", candidate, R_true))
        left = rotation_angle(candidate @ Q @ R_true.transpose(0, 2, 1))
        errors[hand] = float(np.median(np.rad2deg(left)))
    hand = min(errors, key=lambda k: errors[k])
    return errors[hand], hand


def run_ours(series: Path, folder: Path) -> Row:
    """Our stages up to the sparse model."""
    images = series / "images" if (series / "images").is_dir() else series
    names = ("ingest", "extract", "match", "map")
    record = run_stages(folder / "ours", Config(), names=names, image_path=images)
    model = read_model(folder / "ours" / "sparse" / "0")
    error, hand = compare_rotations(list(model.image_names), model.cameras.cam_from_world, series)
    r = model.residuals()
    return Row(
        series=series.name,
        program="semsfm",
        num_images=len(list(images.iterdir())),
        registered=model.num_images,
        error_deg=error,
        hand=hand if model.depth_sign.status == "resolved" else f"{hand}, said open",
        rms_px=float(np.sqrt(np.mean(r**2))),
        num_points=len(model.points),
        seconds={name: record.stages[name].seconds for name in names[1:]},
    )


def run_colmap(series: Path, folder: Path, *, expert: bool) -> Row:
    """COLMAP's extraction, sequential matching and incremental mapping."""
    name = "expert" if expert else "defaults"
    work = folder / name
    shutil.rmtree(work, ignore_errors=True)
    work.mkdir(parents=True)
    images, database = folder / "ours" / "images", work / "database.db"
    count = len(list(images.iterdir()))
    seconds = {}
    begin = time.monotonic()
    reader = pycolmap.ImageReaderOptions()
    if expert:
        width, height = (
            pycolmap.Bitmap.read(str(next(images.iterdir())), False).to_array().shape[1::-1]
        )
        reader.camera_model = "SIMPLE_PINHOLE"
        reader.camera_params = f"{EXPERT_FOCAL_PX},{width / 2},{height / 2}"
    extraction = pycolmap.FeatureExtractionOptions()
    extraction.use_gpu = False
    pycolmap.extract_features(
        str(database),
        str(images),
        camera_mode=pycolmap.CameraMode.SINGLE,
        reader_options=reader,
        extraction_options=extraction,
        device=pycolmap.Device.cpu,
    )
    seconds["extract"] = time.monotonic() - begin
    begin = time.monotonic()
    matching = pycolmap.FeatureMatchingOptions()
    matching.use_gpu = False
    pairing = pycolmap.SequentialPairingOptions()
    pairing.overlap = OVERLAP
    pycolmap.match_sequential(
        str(database),
        matching_options=matching,
        pairing_options=pairing,
        device=pycolmap.Device.cpu,
    )
    seconds["match"] = time.monotonic() - begin
    begin = time.monotonic()
    options = pycolmap.IncrementalPipelineOptions()
    if expert:
        options.ba_refine_focal_length = False
        options.ba_refine_extra_params = False
        options.max_focal_length_ratio = 1e9
        options.mapper.max_focal_length_ratio = 1e9
        options.triangulation.max_focal_length_ratio = 1e9
    models = pycolmap.incremental_mapping(
        str(database), str(images), str(work / "sparse"), options=options
    )
    seconds["map"] = time.monotonic() - begin
    row = Row(series=series.name, program=f"COLMAP {name}", num_images=count, seconds=seconds)
    if models:
        model = max(models.values(), key=lambda m: m.num_reg_images())
        registered = sorted((i for i in model.images.values() if i.has_pose), key=lambda i: i.name)
        R = np.array([np.asarray(i.cam_from_world().matrix())[:, :3] for i in registered])
        row.registered = len(registered)
        row.error_deg, row.hand = compare_rotations([i.name for i in registered], R, series)
        row.num_points = model.num_points3D()
        row.rms_px = float(model.compute_mean_reprojection_error()) / np.sqrt(2.0)
    return row


def table(rows: list[Row]) -> str:
    """In Markdown."""
    cells = []
    ours: dict[str, float] = {}
    for r in rows:
        ours.setdefault(r.series, r.total_s)  # the first of a series
        s = [r.seconds.get(k, float("nan")) for k in ("extract", "match", "map")]
        cells.append(
            [
                r.series,
                r.program,
                f"{r.registered} / {r.num_images}",
                "-" if np.isnan(r.error_deg) else f"{r.error_deg:.3f} deg",
                r.hand,
                f"{r.rms_px:.2f}",
                r.num_points,
                *(f"{seconds:.1f}" for seconds in (*s, r.total_s, r.cpu_s)),
                f"{r.total_s / ours[r.series]:.1f}",
            ]
        )
    return tables.table(HEAD, cells)


def warm_up() -> None:
    """Compile the kernels once, so that the times are those of every run but the first."""
    from semsfm_colmap.factorization.options import FactorizationOptions
    from semsfm_colmap.mapping.parts import map_observations
    from semsfm_colmap.refinement.options import RefinementOptions
    from semsfm_colmap.synthetic.tracks import simulate_tracks

    s = simulate_tracks(num_images=5, range_deg=40, num_tracks=200, rng=np.random.default_rng(0))
    map_observations(
        s.observations,
        tuple("abcde"),
        np.full((5, 2), 1000),
        factorization=FactorizationOptions(),
        refinement=RefinementOptions(),
    )


def main() -> None:
    """Command line."""
    parser = tables.parser("vs_colmap", __doc__)
    parser.add_argument("series", nargs="+", type=Path, metavar="SERIES")
    parser.add_argument("--output", type=Path, default=Path("out/benchmark_vs_colmap"))
    parser.add_argument("--skip-defaults", action="store_true", help="the expert set-up alone")
    parser.add_argument("--runs", type=int, default=3, help="of each program, for medians")
    tables.add_page_option(parser, "vs_colmap")
    args = parser.parse_args()
    warm_up()
    rows = []
    for series in args.series:
        folder = args.output / series.name
        programs: list[Callable[[], Row]] = [
            lambda s=series, f=folder: run_ours(s, f),  # type: ignore[misc]
            lambda s=series, f=folder: run_colmap(s, f, expert=True),  # type: ignore[misc]
        ]
        if not args.skip_defaults:
            programs.insert(1, lambda s=series, f=folder: run_colmap(s, f, expert=False))  # type: ignore[misc]
        runs = []
        for _ in range(args.runs):
            shutil.rmtree(folder, ignore_errors=True)
            runs.append([timed(run) for run in programs])
            print(table(runs[-1]), flush=True)
        rows += [median_row(list(of_one)) for of_one in zip(*runs, strict=True)]
    text = table(rows)
    print("\n" + text)
    if args.markdown:
        tables.put(args.markdown, "vs_colmap", text)


if __name__ == "__main__":
    main()
