"""Two rendered series of one specimen in one model, against their common truth.

For each case two series of one grain are rendered, extracted and merged; `alone` is the first
series mapped by itself. Rotations are aligned over all images of the model at once, so that an
error between the series counts in full; "within" aligns each by itself, "between" is the angle
between the two alignments, beside it its standard deviation about each axis by the error bars.
"ratio" is the error of the ratio of the magnifications of the series.

With --pulls small pairs of other specimens are merged, and the errors between the series are held
against their error bars: the pull is the angle between them over sqrt(3) of its standard deviation
about an axis, that of the ratio its error over its own.

With --surface coverage is measured as well: the share of the grain's surface that lies
within 2 px of the mesh, and the share that three images see by the truth.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import tables
from semsfm_colmap.colmap.model.sidecar import FILE_NAME, read_sidecar
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
from semsfm_colmap.records import SeriesSigma
from semsfm_colmap.synthetic.options import SceneName, SynthesizeOptions
from semsfm_colmap.synthetic.series import synthesize
from semsfm_colmap.types import Float, OrthographicCameras, Reconstruction, TriangleMesh

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
PULL_PAIRS: tuple[tuple[SceneName, int, float, float], ...] = (
    ("grain", 51, 70.0, 90.0),
    ("grain", 52, 70.0, 90.0),
    ("grain", 53, 70.0, 90.0),
    ("grain", 54, 90.0, 90.0),
    ("grain", 57, 70.0, 60.0),
    ("grain", 58, 90.0, 90.0),
    ("grain", 71, 70.0, 90.0),
    ("clump", 62, 70.0, 90.0),
    ("clump", 72, 90.0, 60.0),
)
"""Scene and its seed, range of each series, angle at which the second one is mounted; degrees."""
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
    "its sigma about an axis",
    "ratio",
    "its sigma",
)
PULL_HEAD = (
    "pair",
    "rotation error median",
    "between them",
    "its sigma about an axis",
    "pull",
    "ratio",
    "its sigma",
    "pull of the ratio",
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


@dataclass(frozen=True, kw_only=True)
class Accuracy:
    """Errors of a model; those between its series are None where there is one."""

    num_images: int
    rotation_deg: Float
    """(M,)"""
    within_deg: Float
    """(M,) each series aligned by itself"""
    num_shared: int | None = None
    between_deg: float | None = None
    log_ratio: float | None = None
    sigma: SeriesSigma | None = None


def accuracy(project: Project, truth: Truth) -> Accuracy:
    """Errors of the model of a project."""
    model = project.read_main_model()
    alignment, true = aligned(model, truth)
    second = np.array([image.startswith("second_") for image in model.image_names])
    R, S = model.cameras.cam_from_world, true.cam_from_world
    if alignment.depth_reversed:
        R = depth_reversed(R)
    parts = [np.flatnonzero(part) for part in (~second, second) if part.any()]
    worlds = [align_rotations(R[part], S[part]) for part in parts]
    within = [
        rotation_angle(R[part] @ Q @ np.swapaxes(S[part], 1, 2))
        for part, Q in zip(parts, worlds, strict=True)
    ]
    found = Accuracy(
        num_images=model.num_images,
        rotation_deg=np.rad2deg(alignment.rotation_error_rad),
        within_deg=np.rad2deg(np.concatenate(within)),
    )
    if len(parts) == 1:
        return found
    log_ratio = np.log(alignment.scale_ratio)
    obs = model.observations.select(model.inlier)
    seen = np.zeros((len(model.points), 2), dtype=bool)
    seen[obs.track_idx, second[obs.image_idx].astype(np.int64)] = True
    sidecar = read_sidecar(project.sparse / "0" / FILE_NAME)
    return replace(
        found,
        num_shared=int(seen.all(axis=1).sum()),
        between_deg=float(np.rad2deg(rotation_angle(worlds[0] @ worlds[1].T))),
        log_ratio=float(log_ratio[second].mean() - log_ratio[~second].mean()),
        sigma=SeriesSigma(**sidecar["reliability"]["series"][0]),
    )


def accuracy_row(name: str, found: Accuracy, num_given: int) -> list[Any]:
    """A line of the table."""
    row: list[Any] = [
        name,
        f"{found.num_images} / {num_given}",
        "-" if found.num_shared is None else str(found.num_shared),
        f"{np.median(found.rotation_deg):.3f} deg",
        f"{found.rotation_deg.max():.3f} deg",
        f"{np.median(found.within_deg):.3f} deg",
    ]
    return [*row, *between_cells(found)]


def between_cells(found: Accuracy) -> list[str]:
    """How the two series lie to each other, and what the error bars say of it."""
    if found.sigma is None or found.between_deg is None or found.log_ratio is None:
        return ["-"] * 4
    return [
        f"{found.between_deg:.3f} deg",
        f"{found.sigma.turn_deg:.3f} deg",
        f"{100.0 * found.log_ratio:+.3f} %",
        f"{100.0 * found.sigma.scale:.3f} %",
    ]


def pull_rows(work: Path) -> list[list[Any]]:
    """Small pairs: their errors over their error bars, and the root mean square of these."""
    rows: list[list[Any]] = []
    pulls = []
    for number, (scene, seed, range_deg, mount_deg) in enumerate(PULL_PAIRS):
        options = SynthesizeOptions(
            scene=scene, seed=seed, num_images=14, range_deg=range_deg, width_px=320,
            height_px=240, databar=False,
        )  # fmt: skip
        name = f"{scene} {seed}, {range_deg:g} deg, mounted at {mount_deg:g} deg"
        first, truth = rendered(work / f"pair{number}" / "first", options)
        again = replace(options, series_seed=seed + 1000, mount_deg=mount_deg)
        second, other = rendered(work / f"pair{number}" / "second", again)
        merged = Project(work / f"pair{number}" / "merged")
        merge_projects([first.path, second.path], merged.path, CONFIG)
        found = accuracy(merged, joined([truth, other], ["first", "second"]))
        assert found.sigma is not None
        assert found.between_deg is not None
        assert found.log_ratio is not None
        turn = found.between_deg / (np.sqrt(3.0) * found.sigma.turn_deg)
        ratio = found.log_ratio / found.sigma.scale
        pulls.append((turn, ratio))
        between, sigma, log_ratio, log_sigma = between_cells(found)
        median = f"{np.median(found.rotation_deg):.3f} deg"
        rows.append(
            [name, median, between, sigma, f"{turn:.2f}", log_ratio, log_sigma, f"{ratio:+.2f}"]
        )
        print(rows[-1], flush=True)
    turn, ratio = np.sqrt(np.mean(np.square(pulls), axis=0))
    rows.append(["root mean square", "", "", "", f"{turn:.2f}", "", "", f"{ratio:.2f}"])
    return rows


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
    parser.add_argument("--pulls", action="store_true", help="also merge the small pairs")
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
        rows.append(accuracy_row("alone", accuracy(first, truth), len(truth.names)))
        print(rows[-1], flush=True)
        for number, (name, options) in enumerate(CASES.items()):
            if name not in args.only:
                continue
            second, other = rendered(work / str(number) / "second", options)
            merged = Project(work / str(number) / "merged")
            merge_projects([first.path, second.path], merged.path, CONFIG)
            both = joined([truth, other], ["first", "second"])
            rows.append(accuracy_row(name, accuracy(merged, both), len(both.names)))
            print(rows[-1], flush=True)
            if args.surface and not covered:
                covered = surface_rows((first, truth), (merged, both), name)
        pulls = pull_rows(work) if args.pulls else []
    parts = [tables.table(HEAD, rows)]
    if pulls:
        parts.append(tables.table(PULL_HEAD, pulls))
    if covered:
        parts.append(tables.table(SURFACE_HEAD, covered))
    text = "\n\n".join(parts)
    print(text)
    if args.markdown:
        tables.put(args.markdown, "merge", text)


if __name__ == "__main__":
    main()
