"""How well specimen and holder are told apart without any option: docs/segmentation.md.

    python -m benchmarks.segmentation --simulated 5 --project PROJECT:TRUTH ...

A project with the folder of its truth, after densify and mesh: each triangle of its mesh, or each
point of its cloud where it has none, has the true label of the nearest triangle of the truth.
Series of `semsfm synthesize` bring their labels; for the older ones without, the ribbon and the
stalk are found by their shape (`by_shape`).
`--simulated N`: the clouds that a perfect stereo would see of N seeds of each rendered scene
(`semsfm_colmap.synthetic.visible_cloud`), and of the same scenes with the holder taken away.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.tables import add_page_option, parser, put, table
from semsfm_colmap.colmap.model.sparse import read_model
from semsfm_colmap.evaluation.truth import load_truth
from semsfm_colmap.geometry.alignment import Similarity, align_cameras_both_hands
from semsfm_colmap.geometry.mesh_normals import face_normals
from semsfm_colmap.io.open3d_rays import as_tensor, ray_scene
from semsfm_colmap.io.ply import read_ply_cloud, read_ply_mesh
from semsfm_colmap.segmentation.names import SPECIMEN
from semsfm_colmap.segmentation.options import SegmentationOptions
from semsfm_colmap.segmentation.propose import propose
from semsfm_colmap.segmentation.support import fit_axis_line
from semsfm_colmap.segmentation.transfer import face_labels, nearest_labels
from semsfm_colmap.surface.mesh.halfedges import component_labels, opposite_halfedge
from semsfm_colmap.synthetic.options import SceneName, SynthesizeOptions
from semsfm_colmap.synthetic.visible_cloud import VisibleCloud, visible_cloud
from semsfm_colmap.types import Bool, Float, Int, OrthographicCameras, PointCloud

HEAD = ("series", "found", "judged", "true holder", "of the holder found", "of the specimen taken")
CLOUD_HEAD = (
    "scene",
    "seeds",
    "found",
    "of the holder found, worst",
    "of the specimen taken, worst",
)
FIRST_SEED = 1000
SCENES: tuple[SceneName, ...] = ("clump", "grain", "field")
NUM_IMAGES = {"clump": 36, "grain": 24, "field": 9}

# the shapes of the two series that were rendered before labels were written
FREE_RIBBON = 1.45
"""Beyond this x, in scene units, there is nothing but ribbon."""
RIBBON_START = 0.0
SHELL, HALF_WIDTH = 0.05, 0.14
"""A face of the ribbon is within these of its cylinder and its centre line."""
RADIAL = 0.87
"""Its normal is within 30 degrees of radial, which granules are not."""
RIM_FROM, NUM_RIM_RINGS = 0.1, 4
"""Its rim is this far from the centre line, and so many triangles wide."""
MIN_RIBBON_PATCH = 0.02
"""Area of a patch of such faces; granules in the right place make patches of 0.002."""
FREE_STALK, GRAIN_END, GRAIN_RADIUS = 1.3, 0.9, 1.0


def held_fraction(label: Int, truth: Bool) -> tuple[float, float]:
    """Share of the holder that is found, and of the specimen that is taken for it."""
    held = label != SPECIMEN
    found = float(held[truth].mean()) if truth.any() else float("nan")
    return found, float(held[~truth].mean())


def percent(share: float) -> str:
    """A share as a cell of a table."""
    return "-" if np.isnan(share) else f"{100 * share:.2f} %"


def true_labels(folder: Path) -> tuple[Float, Int, Bool]:
    """Vertices (V, 3), faces (F, 3) and whether each face is of the holder (F,)."""
    with np.load(folder / "mesh.npz") as data:
        vertices = data["vertices"].astype(np.float64)
        faces = data["faces"].astype(np.int64)
        if "vertex_label" in data:
            return vertices, faces, data["vertex_label"][faces].max(axis=1) > 0
    truth = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
    return vertices, faces, by_shape(vertices, faces, truth)


def by_shape(vertices: Float, faces: Int, truth: dict) -> Bool:
    """The ribbon of the older spore series, the stalk of the older pollen series, nothing else."""
    centre = vertices[faces].mean(axis=1)
    if truth["kind"] == "pollen":
        free = centre[:, 1] > FREE_STALK
        axis = fit_axis_line(centre[free, 1], centre[free][:, [0, 2]])
        away = centre[:, [0, 2]] - axis[:2] - centre[:, [1]] * axis[2:4]
        near = np.abs(np.linalg.norm(away, axis=1) - axis[4]) < SHELL
        outside = np.linalg.norm(centre, axis=1) > GRAIN_RADIUS
        return np.asarray(free | (near & outside & (centre[:, 1] > GRAIN_END)))
    if truth["kind"] == "spore":
        return _ribbon(vertices, faces, centre, truth["meta"]["coil_pitch"])
    return np.zeros(len(faces), dtype=bool)


def _ribbon(vertices: Float, faces: Int, centre: Float, pitch: float) -> Bool:
    normal = face_normals(vertices, faces)
    area = 0.5 * np.linalg.norm(normal, axis=1)
    free = centre[:, 0] > FREE_RIBBON
    # triangles on the smooth ribbon are large and few: as many of them as their area asks for
    rng = np.random.default_rng(0)
    rows = rng.choice(np.flatnonzero(free), 20_000, p=area[free] / area[free].sum())
    weight = rng.dirichlet(np.ones(3), len(rows))
    sample = np.einsum("nk,nki->ni", weight, vertices[faces[rows]])
    axis = fit_axis_line(sample[:, 0], sample[:, 1:])

    def cylinder(p: Float) -> tuple[Float, Float, Float]:
        away = p[:, 1:] - axis[:2] - p[:, [0]] * axis[2:4]
        phase = np.arctan2(away[:, 1], away[:, 0]) - 2.0 * np.pi * p[:, 0] / pitch
        return np.linalg.norm(away, axis=1), phase, away

    middle = np.angle(np.exp(1j * cylinder(sample)[1]).mean())
    r, phase, away = cylinder(centre)
    off = ((phase - middle + np.pi) % (2.0 * np.pi) - np.pi) * pitch / (2.0 * np.pi)
    band = (np.abs(r - axis[4]) < SHELL) & (np.abs(off) < HALF_WIDTH)
    band &= centre[:, 0] > RIBBON_START
    radial = np.abs(np.einsum("fi,fi->f", normal[:, 1:], away)) / np.maximum(2.0 * area * r, 1e-300)
    face = (band & (radial > RADIAL)) | free
    where = np.flatnonzero(face)
    patch = component_labels(faces[where])
    large = np.bincount(patch, weights=area[where])[patch] > MIN_RIBBON_PATCH
    out = np.zeros(len(faces), dtype=bool)
    out[where[large]] = True
    # the rim, whose normals are along the axis: what goes on from these faces at their edges
    rim = band & (np.abs(off) > RIM_FROM) & (radial < RADIAL)
    opposite = opposite_halfedge(faces)
    side = np.flatnonzero(opposite >= 0)
    for _ in range(NUM_RIM_RINGS):
        beside = side[out[opposite[side] // 3] & rim[side // 3]] // 3
        out[beside] = True
    return out


def project_row(text: str) -> list[str]:
    """PROJECT:TRUTH as a row of the table."""
    folder, _, truth_text = text.partition(":")
    project, truth_folder = Path(folder), Path(truth_text)
    model = read_model(project / "sparse" / "0")
    cloud = read_ply_cloud(project / "dense" / "fused.ply")
    found = propose(cloud, model.cameras, model.image_size_px, SegmentationOptions())
    label, at, what = found.label, cloud.points, "points"
    mesh_path = project / "mesh" / "mesh.ply"
    if mesh_path.is_file():
        mesh = read_ply_mesh(mesh_path)
        label = face_labels(nearest_labels(cloud.points, label, mesh.vertices), mesh.faces)
        at, what = mesh.vertices[mesh.faces].mean(axis=1), "triangles"
    vertices, faces, held = true_labels(truth_folder)
    world = true_from_estimated(model.image_names, model.cameras, truth_folder)
    centre = world.apply(at)
    answer = ray_scene(vertices, faces).compute_closest_points(as_tensor(centre.astype(np.float32)))
    truth = held[answer["primitive_ids"].numpy().astype(np.int64)]
    share = held_fraction(label, truth)
    name = truth_folder.resolve().name
    if name == "series":
        name = truth_folder.resolve().parent.name
    return [
        name,
        found.message,
        f"{len(label)} {what}",
        str(int(truth.sum())),
        *map(percent, share),
    ]


def true_from_estimated(
    names: Sequence[str], cameras: OrthographicCameras, truth_folder: Path
) -> Similarity:
    """The world of the truth from that of a model, by the cameras alone."""
    truth = load_truth(truth_folder)
    number = {Path(name).stem: k for k, name in enumerate(truth.names)}
    true = truth.cameras.select(np.array([number[Path(name).stem] for name in names]))
    hands = align_cameras_both_hands(cameras, true)
    return min(hands, key=lambda hand: hand.rotation_rms_rad).true_from_estimated


def without_holder(seen: VisibleCloud) -> VisibleCloud:
    """The same with the holder taken away."""
    keep = seen.label == 0
    assert seen.cloud.normals is not None
    cloud = PointCloud(points=seen.cloud.points[keep], normals=seen.cloud.normals[keep])
    return replace(seen, cloud=cloud, label=seen.label[keep])


def simulated_rows(num_seeds: int) -> list[list[str]]:
    """Each scene over seeds, with and without its holder."""
    rows = []
    for scene in SCENES:
        cases: dict[str, list[tuple[str, float, float]]] = {}
        for seed in range(FIRST_SEED, FIRST_SEED + num_seeds):
            options = SynthesizeOptions(
                scene=scene,
                seed=seed,
                num_images=NUM_IMAGES[scene],
                width_px=480,
                height_px=360,
                databar=False,
            )
            seen = visible_cloud(options)
            alone = [(f"{scene} alone", without_holder(seen))] if seen.label.any() else []
            for name, cloud in [(scene, seen), *alone]:
                found = propose(
                    cloud.cloud, cloud.cameras, cloud.image_size_px, SegmentationOptions()
                )
                share = held_fraction(found.label, cloud.label > 0)
                cases.setdefault(name, []).append((found.message, *share))
                print(name, seed, found.message, *map(percent, share), flush=True)
        for name, results in cases.items():
            said, recall, taken = zip(*results, strict=True)
            rows.append(
                [
                    name,
                    str(num_seeds),
                    "; ".join(sorted(set(said))),
                    percent(float(np.min(recall))),
                    percent(float(np.max(taken))),
                ]
            )
    return rows


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the benchmark."""
    command = parser("segmentation", __doc__)
    command.add_argument("--project", action="append", default=[], metavar="PROJECT:TRUTH")
    command.add_argument("--simulated", type=int, default=0, metavar="SEEDS")
    add_page_option(command, "segmentation")
    parsed = command.parse_args(arguments)
    texts = []
    if parsed.project:
        texts.append(table(HEAD, [project_row(text) for text in parsed.project]))
    if parsed.simulated:
        texts.append(table(CLOUD_HEAD, simulated_rows(parsed.simulated)))
    text = "\n\n".join(texts)
    print(text)
    if parsed.markdown is not None:
        put(parsed.markdown, "segmentation", text)


if __name__ == "__main__":
    main()
