"""What the guided second pass and its filters do to tracks, noise and rotations.

A SERIES is a folder with images/ and, for the errors, truth.json. Features (COLMAP's SIFT, turned
to its gradients) and matches are found once a series; each variant maps them anew:

matched        tracks as COLMAP's SIFT, ratio and affine verification leave them, two views on
plain          the model from them, three views on: no guided pass
coarse         the guided pass on structure up to 15 px: shading and all
two rounds     one pass that aligns, one that looks everywhere, and no more
not filled up  no keypoints without a match as further points
drift left in  the observations as they are seen, scan drift and all
own weights    each observation weighed by what its alignment is worth
default        the guided pass as it is

Observations are those that a point of the model rests on. Epipolar errors are distances to the
epipolar lines of the true cameras, over pairs of consecutive images, of matches within 2 px.
The step ratio is the sum of the rotations from image to image over the true sum: shading that moves
with the viewer makes it larger than 1. Times are wall-clock seconds of the mapping on a shared
machine: compare columns of one run, never runs.
"""

from __future__ import annotations

import shutil
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import tables
from semsfm_colmap.colmap.model.sparse import read_model
from semsfm_colmap.config import Config, config_from_dict
from semsfm_colmap.evaluation.compare import evaluate
from semsfm_colmap.evaluation.truth import Truth, load_truth
from semsfm_colmap.geometry.epipolar import epipolar_residual, estimate_affine_fundamental
from semsfm_colmap.pipeline.project import Project
from semsfm_colmap.pipeline.record import RunRecord
from semsfm_colmap.pipeline.runner import run_stages
from semsfm_colmap.pipeline.stages.map import build_observations
from semsfm_colmap.records import MapRecord
from semsfm_colmap.types import Float, Reconstruction

TRUE_MATCH_PX = 2.0
PLAIN_SIFT = config_from_dict({"features": {"upright": False}})
"""As everybody has it: turned to the dominant gradients, whatever the program would choose."""
VARIANTS: dict[str, dict[str, dict[str, Any]]] = {
    "plain": {"guided": {"enabled": False}},
    "coarse": {"guided": {"high_pass_px": 15.0}},
    "two rounds": {"guided": {"rounds": 2}},
    "not filled up": {"guided": {"fill_up_to": 0}},
    "drift left in": {"refinement": {"drift_sigma_px": 0.0}},
    "own weights": {"guided": {"own_weights": True}},
    "default": {},
}
HEAD = (
    "series",
    "variant",
    "images",
    "points",
    "observations",
    "mean length",
    "residual px",
    "epipolar px",
    "within 2 px",
    "rotation deg",
    "step ratio",
    "closure deg",
    "points px",
    "s",
)


def true_cameras(truth: Truth, names: tuple[str, ...], crop: tuple[float, float]) -> Any:
    """The true cameras of the images of a model, in the coordinates of its prepared images."""
    number = {Path(name).stem: k for k, name in enumerate(truth.names)}
    cameras = truth.cameras.select(np.array([number[Path(name).stem] for name in names]))
    return replace(cameras, translation_px=cameras.translation_px - np.asarray(crop))


def epipolar_errors(model: Reconstruction, cameras: Any) -> Float:
    """Distances in px to the true epipolar lines of all matches of consecutive images."""
    obs = model.observations.select(model.inlier)
    rng = np.random.default_rng(0)
    X = rng.normal(size=(40, 3)) * 300.0
    errors = []
    for i in range(model.num_images - 1):
        a, b = (np.flatnonzero(obs.image_idx == k) for k in (i, i + 1))
        _, p, q = np.intersect1d(
            obs.track_idx[a], obs.track_idx[b], assume_unique=True, return_indices=True
        )
        F = estimate_affine_fundamental(
            cameras.project(X, np.full(40, i)), cameras.project(X, np.full(40, i + 1))
        )
        distance = np.abs(epipolar_residual(F, obs.xy[a[p]], obs.xy[b[q]]))
        # |n| = 1 in 4-space: its half in the second image turns it into a distance to the line
        errors.append(distance / np.linalg.norm(F[2, :2]) * np.linalg.norm([*F[2, :2], *F[:2, 2]]))
    return np.concatenate(errors)


def share_near_truth(model: Reconstruction, cameras: Any) -> float:
    """Share of the observations within 2 px of the best point under the true cameras."""
    from semsfm_colmap.geometry.points import residuals, solve_points, track_pointer

    obs = model.observations.select(model.inlier)
    A, t = cameras.projection, np.asarray(cameras.translation_px)
    pointer = track_pointer(obs.track_idx, obs.num_tracks)
    w = np.ones(len(obs))
    for _ in range(4):
        X = np.nan_to_num(solve_points(A, t, obs.image_idx, pointer, obs.xy, w))
        r = np.linalg.norm(residuals(A, t, X, obs.image_idx, obs.track_idx, obs.xy), axis=1)
        w = 1.0 / (1.0 + (r / 0.5) ** 2)
    return float(np.mean(r < TRUE_MATCH_PX))


def run_variant(project: Path, series: Path, name: str) -> list[str]:
    """One row of the table."""
    config = config_from_dict(VARIANTS[name])
    begin = time.perf_counter()
    record = run_stages(project, config, names=("map",), force=True)
    seconds = time.perf_counter() - begin
    model = read_model(project / "sparse" / "0")
    r = model.residuals()[model.inlier]
    row = {
        "series": series.name,
        "variant": name,
        "images": str(model.num_images),
        "points": str(len(model.points)),
        "observations": str(int(model.inlier.sum())),
        "mean length": f"{model.track_length().mean():.2f}",
        "residual px": f"{np.sqrt(np.mean(r**2)):.3f}",
        "s": f"{seconds:.1f}",
    }
    mapped = record.result("map", MapRecord)
    guided = None if mapped is None else mapped.diagnostics.guided
    if guided is not None and name in ("coarse", "default"):
        row["variant"] += f" ({guided.high_pass_px:g} px)"
    if (series / "truth.json").is_file():
        truth = load_truth(series)
        figures = evaluate(model, truth)
        cameras = true_cameras(truth, model.image_names, (0.0, 0.0))
        errors = epipolar_errors(model, cameras)
        row |= {
            "epipolar px": f"{np.median(errors[errors < TRUE_MATCH_PX]):.3f}",
            "within 2 px": f"{100 * share_near_truth(model, cameras):.2f} %",
            "rotation deg": f"{figures['rotation_error_median_deg']:.4f}",
            "step ratio": f"{figures['rotation_sum_ratio']:.4f}",
            "closure deg": f"{figures['first_to_last_rotation_error_deg']:.3f}",
            "points px": f"{figures['structure_abs_median_unbiased_px']:.2f}",
        }
    return [row.get(column, "-") for column in HEAD]


def matched_row(project: Path, series: Path) -> list[str]:
    """The verified tracks that every variant starts from."""
    opened = Project(project)
    observations, _, _ = build_observations(opened, RunRecord.read(opened.record), Config())
    row = {
        "series": series.name,
        "variant": "matched",
        "images": str(len(np.unique(observations.image_idx))),
        "points": str(observations.num_tracks),
        "observations": str(len(observations)),
        "mean length": f"{len(observations) / max(observations.num_tracks, 1):.2f}",
    }
    return [row.get(column, "-") for column in HEAD]


def main() -> None:
    """Command line."""
    parser = tables.parser("guided", __doc__)
    parser.add_argument("series", nargs="+", type=Path, metavar="SERIES")
    parser.add_argument("--output", type=Path, default=Path("out/benchmark_guided"))
    tables.add_page_option(parser, "guided")
    arguments = parser.parse_args()
    rows = []
    for series in arguments.series:
        project = arguments.output / series.name
        images = series / "images" if (series / "images").is_dir() else series
        run_stages(project, PLAIN_SIFT, names=("ingest", "extract", "match"), image_path=images)
        rows.append(matched_row(project, series))
        for name in VARIANTS:
            work = arguments.output / f"{series.name}.{name.split()[0]}"
            shutil.rmtree(work, ignore_errors=True)
            shutil.copytree(project, work)
            rows.append(run_variant(work, series, name))
            print(" ".join(rows[-1]), flush=True)
            shutil.rmtree(work)
    text = tables.table(HEAD, rows)
    print(text)
    if arguments.markdown is not None:
        tables.put(arguments.markdown, "guided", text)


if __name__ == "__main__":
    main()
