"""Two rendered series of one specimen in one model, against their common truth.

For each case two series of one grain are rendered, extracted and merged; `alone` is the first
series mapped by itself. Rotations are aligned over all images of the model at once, so that an
error between the series counts in full; "within" aligns each by itself, "between" is the angle
between the two alignments. "ratio" is the error of the ratio of the magnifications of
the series. With --surface coverage is measured as well: the share of the grain's surface that lies
within 2 px of the mesh, and the share that three images see by the truth.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import tables
from semsfm_colmap.config import config_from_dict
from semsfm_colmap.evaluation.distance import Surface
from semsfm_colmap.evaluation.truth import Truth, load_truth
from semsfm_colmap.geometry.alignment import (
    CameraAlignment,
    align_cameras_both_hands,
    align_rotations,
)
from semsfm_colmap.geometry.rotations import depth_reversed, rotation_angle
from semsfm_colmap.io.ply import read_ply_mesh
from semsfm_colmap.pipeline.merge import merge_projects
from semsfm_colmap.pipeline.project import Project
from semsfm_colmap.pipeline.runner import run_stages
from semsfm_colmap.synthetic.options import SynthesizeOptions
from semsfm_colmap.synthetic.series import synthesize
from semsfm_colmap.types import OrthographicCameras, Reconstruction, TriangleMesh

FIRST = SynthesizeOptions(
    seed=31, num_images=18, range_deg=85.0, width_px=1024, height_px=820, databar=False
)
CONFIG = config_from_dict({"refinement": {"scanned": "yes"}})
"""Plain PNGs say nothing of a microscope."""
CASES = {
    "perpendicular axes": replace(FIRST, series_seed=32, mount_deg=90.0),
    "1.7 times the magnification": replace(
        FIRST, series_seed=33, mount_deg=25.0, start_deg=10.0, zoom=1.7,
        mesh_edge_px=1.7 * FIRST.mesh_edge_px,
    ),
}  # fmt: skip
MIN_VIEWS = 3
COVERED_PX = 2.0
NUM_SAMPLES = 40_000
HEAD = (
    "series",
    "images",
    "shared points",
    "rotation error median",
    "largest",
    "within a series, median",
    "between them",
    "ratio",
)
SURFACE_HEAD = ("series", "seen by three images", "meshed within 2 px", "gain by truth", "gain")


def joined(truths: Sequence[Truth], labels: Sequence[str]) -> Truth:
    """The truth of merged series, which have one specimen: names as the merged project has them."""
    cameras = [truth.cameras for truth in truths]
    return replace(
        truths[0],
        names=tuple(
            f"{label}_{name}"
            for truth, label in zip(truths, labels, strict=True)
            for name in truth.names
        ),
        cameras=replace(
            cameras[0],
            cam_from_world=np.concatenate([c.cam_from_world for c in cameras]),
            scale_px_per_unit=np.concatenate([c.scale_px_per_unit for c in cameras]),
            translation_px=np.concatenate([c.translation_px for c in cameras]),
        ),
        true_deg=np.concatenate([truth.true_deg for truth in truths]),
    )


def aligned(model: Reconstruction, truth: Truth) -> tuple[CameraAlignment, OrthographicCameras]:
    """The model in the world of the truth, and the true cameras of its images."""
    number = {Path(name).stem: i for i, name in enumerate(truth.names)}
    true = truth.cameras.select(np.array([number[Path(n).stem] for n in model.image_names]))
    hands = align_cameras_both_hands(model.cameras, true)
    return min(hands, key=lambda hand: hand.rotation_rms_rad), true


def accuracy_row(name: str, model: Reconstruction, truth: Truth) -> list[Any]:
    """Errors of a model."""
    alignment, true = aligned(model, truth)
    error = np.rad2deg(alignment.rotation_error_rad)
    second = np.array([image.startswith("second_") for image in model.image_names])
    between, ratio, shared = "-", "-", "-"
    parts = [np.flatnonzero(~second)]
    if second.any():
        parts.append(np.flatnonzero(second))
        log_ratio = np.log(alignment.scale_ratio)
        ratio = f"{100.0 * (log_ratio[second].mean() - log_ratio[~second].mean()):+.3f} %"
        obs = model.observations.select(model.inlier)
        seen = np.zeros((len(model.points), 2), dtype=bool)
        seen[obs.track_idx, second[obs.image_idx].astype(np.int64)] = True
        shared = str(int(seen.all(axis=1).sum()))
    R, S = model.cameras.cam_from_world, true.cam_from_world
    if alignment.depth_reversed:
        R = depth_reversed(R)
    worlds = [align_rotations(R[part], S[part]) for part in parts]
    if second.any():
        between = f"{np.rad2deg(rotation_angle(worlds[0] @ worlds[1].T)):.3f} deg"
    within = [
        rotation_angle(R[part] @ Q @ np.swapaxes(S[part], 1, 2))
        for part, Q in zip(parts, worlds, strict=True)
    ]
    return [
        name,
        f"{model.num_images} / {len(truth.names)}",
        shared,
        f"{np.median(error):.3f} deg",
        f"{error.max():.3f} deg",
        f"{np.rad2deg(np.median(np.concatenate(within))):.3f} deg",
        between,
        ratio,
    ]


def coverage(project: Project, truth: Truth) -> tuple[float, float]:
    """Shares of the surface that three images see, and that the mesh has within 2 px."""
    assert truth.mesh is not None
    alignment, true = aligned(project.read_main_model(), truth)
    surface = Surface(truth.mesh)
    surface.orient(truth.cameras, truth.image_size_px)
    points, normals = surface.samples(NUM_SAMPLES)
    seen = surface.visibility(points, normals, true, truth.image_size_px).sum(axis=1) >= MIN_VIEWS
    mesh = read_ply_mesh(project.mesh / "mesh.ply")
    vertices = alignment.true_from_estimated.apply(mesh.vertices)
    away = Surface(TriangleMesh(vertices=vertices, faces=mesh.faces)).distance(points)
    return float(seen.mean()), float(np.mean(truth.scale_px_per_unit * away <= COVERED_PX))


def surface_rows(
    alone: tuple[Project, Truth], merged: tuple[Project, Truth], name: str
) -> list[list[Any]]:
    """Coverage of the first series and of both."""
    rows = []
    before: tuple[float, float] | None = None
    for label, (project, truth) in (("alone", alone), (name, merged)):
        run_stages(project.path, CONFIG, names=("densify", "mesh"))
        seen, meshed = coverage(project, truth)
        gains = (
            ["", ""] if before is None else [f"{seen / before[0]:.3f}", f"{meshed / before[1]:.3f}"]
        )
        before = before or (seen, meshed)
        rows.append([label, f"{100 * seen:.1f} %", f"{100 * meshed:.1f} %", *gains])
        print(rows[-1], flush=True)
    return rows


def rendered(path: Path, options: SynthesizeOptions) -> tuple[Project, Truth]:
    """A series with its truth, and its project with prepared images."""
    if not (path / "series" / "truth.json").is_file():
        synthesize(path / "series", options)
    project = Project(path)
    run_stages(project.path, CONFIG, names=("ingest",), image_path=path / "series" / "images")
    return project, load_truth(path / "series")


def main() -> None:
    """Command line."""
    parser = tables.parser("merge", __doc__)
    parser.add_argument("--surface", action="store_true", help="also measure the coverage")
    parser.add_argument(
        "--work", type=Path, help="folder that is kept: what is there is not redone"
    )
    parser.add_argument("--only", nargs="+", choices=CASES, default=list(CASES), help="these cases")
    tables.add_page_option(parser, "merge")
    args = parser.parse_args()
    rows: list[list[Any]] = []
    covered: list[list[Any]] = []
    with tempfile.TemporaryDirectory() as folder:
        work = args.work or Path(folder)
        first, truth = rendered(work / "first", FIRST)
        run_stages(first.path, CONFIG, names=("extract", "match", "map"))
        rows.append(accuracy_row("alone", first.read_main_model(), truth))
        print(rows[-1], flush=True)
        for number, (name, options) in enumerate(CASES.items()):
            if name not in args.only:
                continue
            second, other = rendered(work / str(number) / "second", options)
            merged = Project(work / str(number) / "merged")
            merge_projects([first.path, second.path], merged.path, CONFIG)
            both = joined([truth, other], ["first", "second"])
            rows.append(accuracy_row(name, merged.read_main_model(), both))
            print(rows[-1], flush=True)
            if args.surface and not covered:
                covered = surface_rows((first, truth), (merged, both), name)
    parts = [tables.table(HEAD, rows)]
    if covered:
        parts.append(tables.table(SURFACE_HEAD, covered))
    text = "\n\n".join(parts)
    print(text)
    if args.markdown:
        tables.put(args.markdown, "merge", text)


if __name__ == "__main__":
    main()
