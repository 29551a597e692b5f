"""Keypoints turned to their dominant gradients, or upright: matches, images and rotations.

A SERIES is a folder of images, or one with images/ and truth.json; of it every STEP-th image is
taken. Both ways through features, matching and mapping without the guided pass; "trial" is what
the program chooses by itself, from a few pairs. Rotation errors are medians.
"""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path
from typing import Any

from benchmarks import tables
from semsfm_colmap.config import config_from_dict
from semsfm_colmap.errors import SemSfmError
from semsfm_colmap.evaluation.compare import evaluate
from semsfm_colmap.evaluation.truth import load_truth
from semsfm_colmap.pipeline.project import Project
from semsfm_colmap.pipeline.record import RunRecord
from semsfm_colmap.pipeline.runner import run_stages
from semsfm_colmap.pipeline.stages.orientation import try_project_orientations
from semsfm_colmap.records import MatchRecord

STAGES = ("ingest", "extract", "match", "map")
HEAD = (
    "series",
    "step",
    "keypoints",
    "trial",
    "pairs verified",
    "matches",
    "images in the model",
    "rotation error",
)


def measure(series: Path, step: int, images: Path, work: Path) -> list[list[Any]]:
    """Two rows, turned and upright."""
    rows = []
    trial = None
    for upright in (False, True):
        project = Project(work / f"upright-{upright}")
        config = config_from_dict({"features": {"upright": upright}, "guided": {"enabled": False}})
        mapped, rotation = "0", "-"
        try:
            run_stages(project.path, config, names=STAGES, image_path=images)
            model = project.read_main_model()
            mapped = str(model.num_images)
            if (series / "truth.json").is_file():
                figures = evaluate(model, load_truth(series))
                rotation = f"{figures['rotation_error_median_deg']:.3f} deg"
        except SemSfmError as error:
            print(f"{series.name}: {error}", flush=True)
        trial = trial or try_project_orientations(project, project.read_series())
        matched = RunRecord.read(project.record).result("match", MatchRecord)
        pairs = () if matched is None else matched.pairs
        rows.append(
            [
                series.name,
                step,
                "upright" if upright else "turned",
                "yes" if trial.upright == upright else "",
                sum(pair.num_after_distance_filter > 0 for pair in pairs),
                sum(pair.num_after_distance_filter for pair in pairs),
                f"{mapped} / {len(list(images.iterdir()))}",
                rotation,
            ]
        )
        print(rows[-1], flush=True)
    return rows


def main() -> None:
    """Command line."""
    parser = tables.parser("orientation", __doc__)
    parser.add_argument("series", nargs="+", metavar="SERIES[:STEP]")
    tables.add_page_option(parser, "orientation")
    args = parser.parse_args()
    rows = []
    for argument in args.series:
        folder, _, step = argument.partition(":")
        series = Path(folder)
        source = series / "images" if (series / "images").is_dir() else series
        files = [p for p in sorted(source.iterdir()) if p.suffix in (".png", ".jpg", ".tif")]
        with tempfile.TemporaryDirectory() as work:
            images = Path(work) / "images"
            images.mkdir()
            for file in files[:: int(step or 1)]:
                shutil.copy(file, images)
            rows += measure(series, int(step or 1), images, Path(work))
    text = tables.table(HEAD, rows)
    print(text)
    if args.markdown:
        tables.put(args.markdown, "orientation", text)


if __name__ == "__main__":
    main()
