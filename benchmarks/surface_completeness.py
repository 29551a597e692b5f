"""Where a surface is missing: the true surface, step by step from the depth maps to the mesh.

Points are spread evenly over the true surface. Ray casting from the true cameras tells which images
see each; those that three or more see are judged. A point is covered by a cloud or a mesh that
comes within 3 px of it. The step that loses a point is the first one after which nothing covers it
any more:

no depth                no map has a depth at the point's place in its image
wrong depth             the maps have only depths that lie farther than 3 px from the point
too few maps agree      fewer maps than fusion asks for are right
not accepted            enough are right, but fusion takes none of their pixels near the point
layer, stray, island    steps that clean the fused cloud
thinned, smoothed       the cloud that is meshed lies beside the point
not meshed              no triangle, or one that repair took away
covered                 the delivered mesh comes within 3 px

Shares are of the surface that three images see, in percent; tables below split what is missing by
the cosine of the slant in the most frontal image that sees a point, the number of images that see
it, the share of the half-space above it that is open (low in pits and grooves), and the thickness
of the body below it (low on spines, walls and ribbons).

A PROJECT is one after `semsfm mesh`; its TRUTH the folder that `semsfm synthesize` wrote.
"""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from benchmarks import tables
from semsfm_colmap.evaluation.distance import Surface
from semsfm_colmap.evaluation.truth import Truth, load_truth
from semsfm_colmap.geometry.alignment import CameraAlignment, align_cameras_both_hands
from semsfm_colmap.geometry.normals import sampling_distance, statistical_inliers
from semsfm_colmap.io.ply import read_ply_mesh
from semsfm_colmap.pipeline.project import Project
from semsfm_colmap.surface.files import DepthMapFolder
from semsfm_colmap.surface.fusion import fuse as fusing
from semsfm_colmap.surface.fusion.cloud import dominant_layer, smooth_along_normals, thin
from semsfm_colmap.surface.options import SurfaceOptions
from semsfm_colmap.types import Array, Bool, DepthMap, Float, PointCloud, Reconstruction
from semsfm_colmap.types import TriangleMesh as Mesh

WITHIN_PX = (2.0, 3.0, 5.0)
"""Distances at which completeness is given; the second is that of the steps."""
MIN_VIEWS = 3
NUM_SAMPLES = 40_000
NUM_DIRECTIONS = 60
STEPS = (
    "no depth",
    "wrong depth",
    "too few maps agree",
    "not accepted",
    "layer",
    "stray",
    "island",
    "thinned, smoothed",
    "not meshed",
    "covered",
)
BINS: dict[str, tuple[tuple[float, ...], str]] = {
    "cosine to the best image": ((0.0, 0.26, 0.5, 0.71, 0.87, 1.01), "{:.2f} to {:.2f}"),
    "images that see it": ((3, 5, 8, 12, 20, np.inf), "{:g} to {:g}"),
    "open share above": ((0.0, 0.2, 0.4, 0.6, 0.8, 1.01), "{:.1f} to {:.1f}"),
    "thickness below, px": ((0.0, 8.0, 16.0, 32.0, 64.0, np.inf), "{:g} to {:g}"),
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """A project in the world of its truth, lengths in px, and the true surface that images see."""

    name: str
    truth: Truth
    surface: Surface
    alignment: CameraAlignment
    px: float
    """Pixels per unit of the truth"""
    points: Float
    """(N, 3) of the true surface, seen by three images or more"""
    normals: Float
    seen: Bool
    """(N, M)"""
    directions: Float
    """(M, 3) viewing directions of the true cameras"""


def case_of(name: str, reconstruction: Reconstruction, truth: Truth) -> Case:
    """Align a reconstruction with its truth and find what the images see."""
    if truth.mesh is None:
        raise SystemExit(f"{truth.path} holds no surface: render the series with its mesh.")
    number = {Path(n).stem: i for i, n in enumerate(truth.names)}
    idx = np.array([number[Path(n).stem] for n in reconstruction.image_names])
    true = truth.cameras.select(idx)
    hands = align_cameras_both_hands(reconstruction.cameras, true)
    if hands[1].rotation_rms_rad < hands[0].rotation_rms_rad:
        raise SystemExit(f"{name} has the wrong hand: its surface is not that of the truth.")
    surface = Surface(truth.mesh)
    surface.orient(truth.cameras, truth.image_size_px)
    points, normals = surface.samples(NUM_SAMPLES)
    seen = surface.visibility(points, normals, true, truth.image_size_px)
    judged = seen.sum(axis=1) >= MIN_VIEWS
    return Case(
        name=name,
        truth=truth,
        surface=surface,
        alignment=hands[0],
        px=truth.scale_px_per_unit,
        points=points[judged],
        normals=normals[judged],
        seen=seen[judged],
        directions=true.viewing_direction,
    )


def moved(case: Case, points: Float) -> Float:
    """Points of the reconstruction in the world of the truth."""
    return np.asarray(case.alignment.true_from_estimated.apply(points))


def near_cloud(case: Case, cloud: PointCloud | Float) -> Bool:
    """Which points of the true surface a cloud comes near: (N,)."""
    points = cloud.points if isinstance(cloud, PointCloud) else cloud
    if not len(points):
        return np.zeros(len(case.points), dtype=bool)
    distance, _ = cKDTree(moved(case, points)).query(case.points, workers=-1)
    return np.asarray(case.px * distance <= WITHIN_PX[1])


def to_mesh(case: Case, vertices: Float, faces: Array) -> Float:
    """Distance in px of each point of the true surface to a mesh: (N,)."""
    if not len(faces):
        return np.full(len(case.points), np.inf)
    mesh = Mesh(vertices=moved(case, vertices), faces=faces)
    return np.asarray(case.px * Surface(mesh).distance(case.points))


def accuracy(case: Case, mesh: Mesh) -> tuple[float, float, float]:
    """Mesh to truth in px: median, median without the common offset, 95th percentile."""
    signed = case.px * case.surface.signed_distance(moved(case, mesh.vertices))
    unbiased = np.abs(signed - np.median(signed))
    return (
        float(np.median(np.abs(signed))),
        float(np.median(unbiased)),
        float(np.percentile(np.abs(signed), 95)),
    )


def maps_at(
    case: Case, maps: Sequence[DepthMap], reconstruction: Reconstruction
) -> tuple[Array, Array]:
    """How many depth maps have a depth at each point that their image sees, and a right one.

    The place of a point in a map is looked up with its eight neighbours; right is a depth whose
    surface, across it, lies within 3 px.
    """
    inverse = case.alignment.true_from_estimated.inverse
    points = inverse.apply(case.points)
    normals = inverse.apply_to_vectors(case.normals)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    cameras = reconstruction.cameras
    any_depth, right = (np.zeros(len(points), dtype=np.int64) for _ in range(2))
    names = list(reconstruction.image_names)
    unit = 1.0 / (case.px * case.alignment.true_from_estimated.scale)
    for depth_map in maps:
        i = names.index(depth_map.image_name)
        H, W = depth_map.depth.shape
        size = reconstruction.image_size_px[i]
        xy = cameras.project(points, np.full(len(points), i)) * (np.array([W, H]) / size)
        ix, iy = (np.floor(xy).astype(np.int64)).T
        z = points @ cameras.viewing_direction[i]
        cosine = -(normals @ cameras.viewing_direction[i])
        least = np.full(len(points), np.inf)
        for dy in (-1, 0, 1):
            for dx in (-1, 0, 1):
                depth = depth_map.depth[np.clip(iy + dy, 0, H - 1), np.clip(ix + dx, 0, W - 1)]
                away = np.abs(depth - z) * np.maximum(cosine, 0.1)
                least = np.fmin(least, np.where(case.seen[:, i], away, np.inf))
        any_depth += np.isfinite(least)
        right += least <= WITHIN_PX[1] * unit
    return any_depth, right


def steps(
    case: Case,
    maps: Sequence[DepthMap],
    reconstruction: Reconstruction,
    image_path: Path,
    options: SurfaceOptions,
    mesh: Mesh,
) -> tuple[Array, Float]:
    """The step that loses each point, as a number of `STEPS`, and its distance to the mesh."""
    any_depth, right = maps_at(case, maps, reconstruction)
    fused = fusing.gathered(maps, reconstruction, image_path, options)
    layer = fused.cloud.select(dominant_layer(fused.cloud, fused.weight, fused.spacing))
    inlier = statistical_inliers(
        layer.points, options.num_outlier_neighbors, options.max_fused_outlier_sigma
    )
    stray = layer.select(inlier)
    final = fusing.fuse(maps, reconstruction, image_path, options)
    thinned = thin(final, options.thinning_factor * sampling_distance(final.points))
    thinned = smooth_along_normals(
        thinned, options.num_normal_neighbors, options.num_smoothing_iterations
    )
    away = to_mesh(case, mesh.vertices, mesh.faces)
    reached = [
        any_depth > 0,
        right > 0,
        right > options.min_consistent_maps,
        near_cloud(case, fused.cloud),
        near_cloud(case, layer),
        near_cloud(case, stray),
        near_cloud(case, final),
        near_cloud(case, thinned),
        away <= WITHIN_PX[1],
    ]
    # the last step that still has the point; what the mesh covers is covered, whoever gave it
    lost = np.zeros(len(case.points), dtype=np.int64)
    for k, has in enumerate(reached):
        lost[has] = k + 1
    return lost, away


def figures_of(case: Case) -> dict[str, Float]:
    """What the missing parts are split by: (N,) each."""
    cosine = np.where(case.seen, -(case.normals @ case.directions.T), 0.0)
    k = np.arange(NUM_DIRECTIONS) + 0.5
    polar, turn = np.arccos(1.0 - 2.0 * k / NUM_DIRECTIONS), np.pi * (1.0 + np.sqrt(5.0)) * k
    sphere = np.column_stack(
        [np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)]
    )
    return {
        "cosine to the best image": cosine.max(axis=1),
        "images that see it": case.seen.sum(axis=1).astype(float),
        "open share above": case.surface.openings(case.points, case.normals, sphere),
        "thickness below, px": case.px * case.surface.thickness(case.points, case.normals),
    }


def split(name: str, values: Float, missing: Bool) -> list[list[str]]:
    """Rows of one figure: range, share of the surface, missing in it, part of all that misses."""
    edges, text = BINS[name]
    rows = []
    for low, high in itertools.pairwise(edges):
        inside = (values >= low) & (values < high)
        if inside.any():
            share = 100.0 * missing[inside].mean()
            part = 100.0 * missing[inside].sum() / max(1, missing.sum())
            label = text.format(low, high)
            rows.append([label, f"{100 * inside.mean():.1f}", f"{share:.1f}", f"{part:.1f}"])
    return rows


def read_case(project: Path, truth: Path) -> tuple[Case, Reconstruction, Mesh]:
    """A project after `semsfm mesh`, beside its truth."""
    reconstruction = Project(project).read_main_model()
    case = case_of(project.name, reconstruction, load_truth(truth))
    return case, reconstruction, read_ply_mesh(Project(project).mesh / "mesh.ply")


def quality(case: Case, mesh: Mesh, away: Float) -> list[str]:
    """Accuracy and completeness of a mesh as cells of a table."""
    median, unbiased, p95 = accuracy(case, mesh)
    return [
        f"{median:.2f}",
        f"{unbiased:.2f}",
        f"{p95:.2f}",
        *(f"{100 * np.mean(away <= within):.1f}" for within in WITHIN_PX),
    ]


QUALITY = ("median px", "less the bias", "95 % px", *(f"within {w:g} px %" for w in WITHIN_PX))


def report(cases: list[tuple[Path, Path]], options: SurfaceOptions) -> str:
    """All tables of some projects."""
    overview, lost_rows, parts = [], [], []
    for project, truth in cases:
        case, reconstruction, mesh = read_case(project, truth)
        folder = Project(project).dense / "depth_maps"
        names = [n for n in reconstruction.image_names if (folder / f"{n}.npz").is_file()]
        maps = DepthMapFolder(folder, names)
        lost, away = steps(case, maps, reconstruction, Project(project).images, options, mesh)
        overview.append([case.name, *quality(case, mesh, away)])
        shares = 100.0 * np.bincount(lost, minlength=len(STEPS)) / len(lost)
        lost_rows.append([case.name, *(f"{s:.1f}" for s in shares)])
        missing = away > WITHIN_PX[1]
        for name, values in figures_of(case).items():
            head = (f"{case.name}: {name}", "surface %", "missing there %", "of all missing %")
            parts.append(tables.table(head, split(name, values, missing)))
    return "\n\n".join(
        [
            tables.table(("series", *QUALITY), overview),
            tables.table(("series", *STEPS), lost_rows),
            *parts,
        ]
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Read the command line, print the tables, put them into a page."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.surface_completeness",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--case", nargs=2, type=Path, action="append", metavar=("PROJECT", "TRUTH"), required=True
    )
    parser.add_argument("--markdown", type=Path, help="page to put the tables into")
    parsed = parser.parse_args(arguments)
    text = report([(p, t) for p, t in parsed.case], SurfaceOptions())
    print(text)
    if parsed.markdown is not None:
        tables.put(parsed.markdown, "surface_completeness", text)


if __name__ == "__main__":
    main()
