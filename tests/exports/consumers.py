"""Other programs run on our files: each function gives back the figures that it reports.

Used by test_consumers.py and by benchmarks/consumers.py.
"""

from __future__ import annotations

import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from semsfm_colmap.colmap.library import pycolmap
from semsfm_colmap.colmap.presets import (
    DensePreset,
    bundle_adjustment_options,
    command_flags,
    pipeline_options,
    poisson_meshing_options,
    stereo_fusion_options,
)
from semsfm_colmap.geometry.alignment import align_rotations
from semsfm_colmap.geometry.rotations import rotation_angle
from semsfm_colmap.types import Reconstruction
from tests.exports import readers

TIMEOUT_S = 600
MAX_SLANT_DEG = 60.0
"""Between a surface's normal and the viewer, for open3d's TSDF."""


@dataclass(frozen=True)
class Figures:
    """What a program says of a model."""

    num_images: int
    num_points: int
    mean_error_px: float


def has_colmap() -> bool:
    """Whether a colmap binary is there."""
    return shutil.which("colmap") is not None


def run_colmap(command: str, *arguments: str | Path) -> str:
    """Run a colmap command; its output."""
    done = subprocess.run(
        ["colmap", command, *(str(a) for a in arguments)],
        capture_output=True,
        text=True,
        timeout=TIMEOUT_S,
        check=False,
    )
    text = done.stdout + done.stderr
    assert done.returncode == 0, f"colmap {command} returned {done.returncode}: {text[-600:]}"
    assert "ERROR" not in text, text[-600:]
    return text


def figures(model: Any) -> Figures:
    """Of a pycolmap model."""
    model.update_point_3d_errors()
    return Figures(
        int(model.num_reg_images()),
        int(model.num_points3D()),
        float(model.compute_mean_reprojection_error()),
    )


def read(folder: Path) -> Any:
    return pycolmap.Reconstruction(str(folder))


def made(folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    return folder


# colmap's command line ---------------------------------------------------------------------------


def cli_analyze(model: Path) -> Figures:
    text = run_colmap("model_analyzer", "--path", model)

    def value(label: str) -> float:
        found = re.search(rf"{label}: ([0-9.]+)", text)
        assert found is not None, text
        return float(found.group(1))

    return Figures(
        int(value("Registered images")), int(value("Points")), value("Mean reprojection error")
    )


def scene_figures(scene: readers.Scene, *, y_up: bool = False, shift: Any = (0.0, 0.0)) -> Figures:
    """Of a model in a reader's terms; `shift` is added to the projections.

    The mean error is COLMAP's: over points, each with the mean of its observations.
    """
    flip = np.array([1.0, -1.0 if y_up else 1.0])
    errors: dict[int, list[float]] = {}
    for view in scene.views.values():
        owned = view.point_ids >= 0
        ids = view.point_ids[owned]
        X = np.array([scene.points[int(j)] for j in ids]).reshape(-1, 3)
        gap = view.project(X) * flip + np.asarray(shift) - view.xy[owned] * flip
        for j, error in zip(ids, np.linalg.norm(gap, axis=1), strict=True):
            errors.setdefault(int(j), []).append(float(error))
    mean = float(np.mean([np.mean(e) for e in errors.values()]))
    return Figures(len(scene.views), len(scene.points), mean)


def own_figures(made: Reconstruction) -> Figures:
    """Of the orthographic cameras of the sidecar, with COLMAP's mean error."""
    error = np.linalg.norm(made.residuals(), axis=1)[made.inlier]
    track = made.observations.track_idx[made.inlier]
    num = np.bincount(track, minlength=len(made.points))
    total = np.bincount(track, weights=error, minlength=len(made.points))
    return Figures(made.num_images, len(made.points), float(np.mean(total[num > 0] / num[num > 0])))


def cli_convert(model: Path, kind: str, out: Path, image_size: tuple[int, int]) -> Figures:
    made(out)
    target = {"TXT": out, "NVM": out / "model.nvm", "Bundler": out / "bundle", "PLY": out / "m.ply"}
    run_colmap(
        "model_converter",
        *("--input_path", model, "--output_path", target[kind], "--output_type", kind),
    )
    if kind == "TXT":
        return scene_figures(readers.read_text(out))
    if kind == "NVM":
        # COLMAP's converter leaves the measurements where they are in the image
        return scene_figures(readers.read_nvm(out), shift=np.array(image_size) / 2.0)
    if kind == "Bundler":
        (out / "bundle.bundle.out").rename(out / "bundle.out")
        return scene_figures(readers.read_bundler(out), y_up=True)
    num_points = len(open3d_cloud(target[kind]))
    return Figures(0, num_points, float("nan"))


def cli_bundle_adjust(model: Path, out: Path) -> Figures:
    paths = ("--input_path", model, "--output_path", made(out))
    run_colmap("bundle_adjuster", *paths, *command_flags("bundle_adjuster"))
    return figures(read(out))


def cli_triangulate(model: Path, database: Path, images: Path, out: Path) -> Figures:
    run_colmap(
        "point_triangulator",
        *("--database_path", database, "--image_path", images),
        *("--input_path", model, "--output_path", made(out)),
        *command_flags("point_triangulator"),
    )
    return figures(read(out))


def cli_undistort(model: Path, images: Path, out: Path) -> Figures:
    run_colmap(
        "image_undistorter",
        *("--image_path", images, "--input_path", model, "--output_path", made(out)),
    )
    return cli_analyze(out / "sparse")


def cli_fuse(workspace: Path, preset: DensePreset) -> int:
    """stereo_fusion on a workspace: the number of points in fused.ply."""
    run_colmap(
        "stereo_fusion",
        *("--workspace_path", workspace, "--input_type", "geometric"),
        *("--output_path", workspace / "fused_cli.ply"),
        *command_flags("stereo_fusion", preset),
    )
    return len(open3d_cloud(workspace / "fused_cli.ply"))


def cli_poisson(cloud: Path, out: Path) -> int:
    """poisson_mesher: the number of faces."""
    flags = command_flags("poisson_mesher")
    run_colmap(
        "poisson_mesher",
        *("--input_path", cloud, "--output_path", out, "--PoissonMeshing.depth", "7"),
        *("--PoissonMeshing.num_threads", "1"),
        *flags,
    )
    return num_faces(out)


# pycolmap ----------------------------------------------------------------------------------------


def py_bundle_adjust(model: Path, out: Path) -> Figures:
    reconstruction = read(model)
    pycolmap.bundle_adjustment(reconstruction, bundle_adjustment_options())
    reconstruction.write_binary(str(made(out)))
    return figures(read(out))


def py_triangulate(model: Path, database: Path, images: Path, out: Path) -> Figures:
    result = pycolmap.triangulate_points(
        read(model), str(database), str(images), str(made(out)), options=pipeline_options()
    )
    return figures(result)


def py_undistort(model: Path, images: Path, out: Path) -> Figures:
    pycolmap.undistort_images(str(made(out)), str(model), str(images))
    return figures(read(out / "sparse"))


def py_fuse(workspace: Path, preset: DensePreset) -> int:
    """stereo_fusion on a workspace: the number of points in fused.ply."""
    pycolmap.stereo_fusion(
        str(workspace / "fused.ply"),
        str(workspace),
        options=stereo_fusion_options(preset),
        output_type="PLY",
    )
    return len(open3d_cloud(workspace / "fused.ply"))


def py_poisson(cloud: Path, out: Path) -> int:
    options = poisson_meshing_options(depth=7)
    # more threads than free cores wait for one another without end
    options.num_threads = 1
    pycolmap.poisson_meshing(str(cloud), str(out), options)
    return num_faces(out)


# open3d ------------------------------------------------------------------------------------------


def open3d_cloud(path: Path) -> np.ndarray:
    """Positions of a PLY as open3d reads them: (N, 3)."""
    import open3d

    return np.asarray(open3d.io.read_point_cloud(str(path)).points)


def num_faces(path: Path) -> int:
    import open3d

    return len(open3d.io.read_triangle_mesh(str(path)).triangles)


def open3d_tsdf(workspace: Path, preset: DensePreset, voxel: float) -> np.ndarray:
    """Vertices of the mesh that open3d's TSDF makes from the depth maps of a dense workspace.

    open3d takes the direction of a ray as the difference of two points one unit apart, in float32
    and in the world: with cameras D units away its error is some 1e-7 D^2. So the world is shrunk
    until the cameras are one unit away. It also weighs all depths alike, and along the ray, where
    an error across a surface seen at a slant counts several times: what is seen at more than
    `MAX_SLANT_DEG` by our normal maps is left out.
    """
    import open3d
    from open3d.core import Dtype, Tensor

    scene = readers.read_binary(workspace / "sparse")
    grid = open3d.t.geometry.VoxelBlockGrid(
        attr_names=("tsdf", "weight"),
        attr_dtypes=(Dtype.Float32, Dtype.Float32),
        attr_channels=((1), (1)),
        voxel_size=voxel / preset.depth_max,
        block_resolution=8,
        block_count=20000,
    )
    for name in (workspace / "stereo" / "fusion.cfg").read_text(encoding="utf-8").splitlines():
        view = scene.views[name]
        path = workspace / "stereo" / "depth_maps" / f"{name}.geometric.bin"
        depth = np.array(readers.read_colmap_map(path))
        normal = readers.read_colmap_map(
            workspace / "stereo" / "normal_maps" / f"{name}.geometric.bin"
        )
        depth[~(-normal[..., 2] > np.cos(np.radians(MAX_SLANT_DEG)))] = 0.0
        scaling = np.array(depth.shape[::-1]) / view.size
        K = np.diag([*scaling, 1.0]) @ view.K
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = view.R, view.t / preset.depth_max
        near = np.ascontiguousarray(depth / preset.depth_max, dtype=np.float32)
        image = open3d.t.geometry.Image(near)
        intrinsic, extrinsic = Tensor(K), Tensor(pose)
        far = 1.1
        blocks = grid.compute_unique_block_coordinates(image, intrinsic, extrinsic, 1.0, far, 4.0)
        grid.integrate(blocks, image, intrinsic, extrinsic, 1.0, far, 4.0)
    vertices = grid.extract_triangle_mesh(2.0).vertex.positions.numpy()
    return np.asarray(vertices, dtype=float) * preset.depth_max


# comparisons -------------------------------------------------------------------------------------


def rotation_change_deg(before: Path, after: Path) -> float:
    """Largest angle between the cameras of two models once their worlds are aligned."""
    poses = []
    for folder in (before, after):
        images = {
            i.name: i.cam_from_world().rotation.matrix() for i in read(folder).images.values()
        }
        poses.append(np.array([images[name] for name in sorted(images)]))
    Q = align_rotations(poses[1], poses[0])
    gap = (poses[1] @ Q) @ np.swapaxes(poses[0], 1, 2)
    return float(np.degrees(rotation_angle(gap)).max())


def preset_of(summary: dict[str, Any]) -> DensePreset:
    """The dense settings from what an export says."""
    keys = ("depth_min", "depth_max", "max_depth_error", "min_num_pixels")
    return DensePreset(**{key: summary[key] for key in keys})


def surface_gap_px(cloud: Path, own: Path, px_per_unit: float) -> np.ndarray:
    """Distance of a cloud's points across our fused surface: (N,) px, along its normals."""
    from scipy.spatial import cKDTree

    from semsfm_colmap.io.ply import read_ply_cloud

    ours, theirs = read_ply_cloud(own), open3d_cloud(cloud)
    _, nearest = cKDTree(ours.points).query(theirs)
    assert ours.normals is not None
    gap = np.einsum("ij,ij->i", theirs - ours.points[nearest], ours.normals[nearest])
    return np.asarray(gap * px_per_unit)
