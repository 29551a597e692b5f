"""`semsfm mesh --colmap_path`: COLMAP folders in all the layouts that their users have."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh

from semsfm_colmap.cli.main import main
from semsfm_colmap.colmap.dense_map import write_map
from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.geometry.mesh_normals import face_normals
from semsfm_colmap.io.ply import read_ply_cloud, read_ply_mesh, write_ply
from semsfm_colmap.pipeline.foreign.mesh_colmap import mesh_colmap
from semsfm_colmap.surface.options import SurfaceOptions
from semsfm_colmap.types import PointCloud
from tests.colmap.perspective_models import (
    RADIUS,
    SIZE,
    around,
    ball,
    ball_depth,
    perspective_model,
    write_model,
)
from tests.oracles.sound_mesh import assert_sound_file

ROOT = Path(__file__).parents[3]
NUM = 1500


def contents(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def assert_ball(folder: Path, tolerance: float = 0.05) -> None:
    """The mesh in a folder is the ball, outside out."""
    assert_sound_file(folder / "mesh.ply")
    mesh = read_ply_mesh(folder / "mesh.ply")
    normal = face_normals(mesh.vertices, mesh.faces)
    outward = np.einsum("fi,fi->f", normal, mesh.vertices[mesh.faces].mean(axis=1))
    assert outward[outward < 0].sum() > -1e-3 * outward.sum()
    away = np.abs(np.linalg.norm(mesh.vertices, axis=1) - RADIUS)
    assert np.median(away) < tolerance * RADIUS
    area = 0.5 * np.linalg.norm(normal, axis=1).sum()
    # nobody sees the poles
    assert 0.75 < area / (4 * np.pi * RADIUS**2) < 1.05


@pytest.fixture(scope="module")
def ball_model():
    colors = np.random.default_rng(0).integers(50, 200, (NUM, 3)).astype(np.uint8)
    return perspective_model(ball(NUM), around(12), colors=colors)


@pytest.mark.parametrize(
    "place", ["sparse/0", "sparse", ".", "dense/0/sparse", "0", "dense/sparse"]
)
@pytest.mark.parametrize("text", [False, True])
def test_a_sparse_model_is_found_where_users_have_it(ball_model, place, text, tmp_path):
    write_model(ball_model, tmp_path / place, text=text)
    record = mesh_colmap(tmp_path)
    assert_ball(tmp_path / "mesh_semsfm")
    assert record.source == "sparse points"
    assert record.num_points > 0.8 * NUM
    assert record.mesh.method == "ball-pivoting"
    said = json.loads((tmp_path / "mesh_semsfm" / "mesh.json").read_text())
    assert said["mesh"]["num_faces"] == record.mesh.num_faces


@pytest.mark.parametrize(
    "camera_model",
    ["SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "OPENCV_FISHEYE", "FULL_OPENCV", "FOV",
     "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "THIN_PRISM_FISHEYE", "SIMPLE_DIVISION",
     "EUCM", "SIMPLE_FISHEYE", "EQUIRECTANGULAR"],
)  # fmt: skip
def test_every_camera_model_is_read(camera_model, tmp_path):
    model = perspective_model(ball(800), around(10), camera_model=camera_model)
    write_model(model, tmp_path / "sparse/0")
    mesh_colmap(tmp_path)
    assert_ball(tmp_path / "mesh_semsfm")


def test_nothing_in_the_folder_is_changed(ball_model, tmp_path):
    write_model(ball_model, tmp_path / "w" / "sparse/0")
    before = contents(tmp_path / "w")
    mesh_colmap(tmp_path / "w", tmp_path / "out")
    assert contents(tmp_path / "w") == before
    mesh_colmap(tmp_path / "w")
    after = contents(tmp_path / "w")
    assert {k: v for k, v in after.items() if not k.startswith("mesh_semsfm/")} == before
    assert set(after) - set(before) == {
        f"mesh_semsfm/{name}" for name in ("mesh.ply", "cloud.ply", "mesh.json")
    }


def test_points_carry_their_colours_to_the_vertices(ball_model, tmp_path):
    write_model(ball_model, tmp_path / "sparse/0")
    mesh_colmap(tmp_path, options=SurfaceOptions(thinning_factor=0.0))
    mesh = read_ply_mesh(tmp_path / "mesh_semsfm" / "mesh.ply")
    known = {tuple(p.color) for p in ball_model.points3D.values()}
    assert mesh.vertex_colors is not None
    assert {tuple(c) for c in mesh.vertex_colors} <= known


def test_of_several_components_the_largest_is_meant_unless_another_is_named(ball_model, tmp_path):
    write_model(perspective_model(ball(900), around(8, 200)), tmp_path / "sparse/0")
    write_model(ball_model, tmp_path / "sparse/1")
    assert mesh_colmap(tmp_path).model_path.endswith("sparse/1")
    named = mesh_colmap(tmp_path, sparse_path=tmp_path / "sparse/0")
    assert named.model_path.endswith("sparse/0")


def dense_workspace(ball_model, folder: Path, *, normals: bool = True) -> Path:
    write_model(ball_model, folder / "sparse")
    for name in ("depth_maps", "normal_maps"):
        (folder / "stereo" / name).mkdir(parents=True)
    for image in ball_model.images.values():
        pose = np.array(image.cam_from_world().matrix())
        matrix = np.array(ball_model.cameras[image.camera_id].calibration_matrix())
        depth = ball_depth(pose, matrix, SIZE[::-1])
        write_map(folder / "stereo/depth_maps" / f"{image.name}.geometric.bin", depth)
        if normals:
            col, row = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
            ray = np.stack([col, row, np.ones_like(col)], axis=-1) @ np.linalg.inv(matrix).T
            normal = (depth[..., None] * ray - pose[:, 3]) / RADIUS * (depth > 0)[..., None]
            write_map(folder / "stereo/normal_maps" / f"{image.name}.geometric.bin", normal)
    return folder


@pytest.mark.parametrize("normals", [True, False])
@pytest.mark.parametrize("method", ["ball-pivoting", "tsdf"])
def test_depth_maps_of_a_dense_workspace_give_the_surface(ball_model, normals, method, tmp_path):
    dense_workspace(ball_model, tmp_path / "dense/0", normals=normals)
    record = mesh_colmap(tmp_path, options=SurfaceOptions(method=method))
    assert record.source == "12 depth maps"
    assert record.num_points > 3 * NUM
    mesh = read_ply_mesh(tmp_path / "mesh_semsfm" / "mesh.ply")
    # half a pixel is 0.01 at the ball
    assert np.median(np.abs(np.linalg.norm(mesh.vertices, axis=1) - RADIUS)) < 0.002
    assert_ball(tmp_path / "mesh_semsfm", 0.01)


def test_depth_maps_that_disagree_are_one_sentence(ball_model, tmp_path):
    folder = dense_workspace(ball_model, tmp_path)
    rng = np.random.default_rng(1)
    for path in (folder / "stereo/depth_maps").iterdir():
        write_map(
            path, rng.uniform(3, 9, SIZE[::-1]).astype(np.float32) * (rng.random(SIZE[::-1]) < 1e-3)
        )
    with pytest.raises(InputError, match="depth maps agree on"):
        mesh_colmap(tmp_path)


@pytest.mark.parametrize("normals", [True, False])
def test_a_fused_cloud_is_taken_with_its_normals_or_the_cameras(ball_model, normals, tmp_path):
    write_model(ball_model, tmp_path / "sparse/0")
    points = ball(6000, seed=5)
    cloud = PointCloud(points=points, normals=points / RADIUS if normals else None)
    (tmp_path / "dense/0").mkdir(parents=True)
    write_ply(tmp_path / "dense/0/fused.ply", cloud)
    record = mesh_colmap(tmp_path)
    assert record.source == "fused.ply"
    assert_ball(tmp_path / "mesh_semsfm")


def test_a_dense_folder_of_other_images_is_left_alone(ball_model, tmp_path):
    write_model(ball_model, tmp_path / "sparse/0")
    other = perspective_model(ball(200), around(4), names=[f"other_{i}.png" for i in range(4)])
    write_model(other, tmp_path / "dense/sparse")
    write_ply(tmp_path / "dense/fused.ply", PointCloud(points=ball(400), normals=ball(400)))
    assert mesh_colmap(tmp_path).source == "sparse points"


def test_two_perspective_images_give_the_part_that_both_see(tmp_path):
    poses = around(2, 60.0)
    write_model(perspective_model(ball(3000), poses), tmp_path / "sparse/0")
    record = mesh_colmap(tmp_path)
    mesh = read_ply_mesh(tmp_path / "mesh_semsfm" / "mesh.ply")
    assert np.abs(np.linalg.norm(mesh.vertices, axis=1) - RADIUS).max() < 0.1 * RADIUS
    assert any("two images" in note for note in record.mesh.notes)


def test_two_parallel_images_are_one_sentence(tmp_path):
    poses = [p * [[1, 1, 1, 1]] for p in around(2, 60.0)]
    for pose in poses:
        pose[:, 3] *= 1e6
    model = perspective_model(ball(500), poses, focal_px=5e7)
    write_model(model, tmp_path / "sparse/0")
    with pytest.raises(InputError, match="one-parameter family"):
        mesh_colmap(tmp_path)


def test_a_planar_scene_is_a_plane(tmp_path):
    rng = np.random.default_rng(2)
    flat = np.column_stack([rng.uniform(-1.5, 1.5, (1200, 2)), np.zeros(1200)])
    normals = np.tile([0.0, 0.0, -1.0], (1200, 1))
    poses = around(5, 60.0)
    write_model(perspective_model(flat, poses, normals=normals), tmp_path / "sparse/0")
    mesh_colmap(tmp_path)
    mesh = read_ply_mesh(tmp_path / "mesh_semsfm" / "mesh.ply")
    assert np.abs(mesh.vertices[:, 2]).max() < 1e-6
    assert face_normals(mesh.vertices, mesh.faces)[:, 2].max() < 0


def test_an_empty_folder_is_one_sentence(tmp_path):
    with pytest.raises(InputError, match=r"holds no COLMAP model: looked for points3D\.bin"):
        mesh_colmap(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_not_there_is_one_sentence(tmp_path):
    with pytest.raises(UsageError, match="is not a folder"):
        mesh_colmap(tmp_path / "nowhere")


@pytest.mark.parametrize("num", [0, 5])
def test_few_points_are_one_sentence(num, tmp_path):
    write_model(perspective_model(ball(num), around(6)), tmp_path / "sparse/0")
    with pytest.raises(InputError, match="too few for a surface"):
        mesh_colmap(tmp_path)


def test_a_model_cut_short_is_one_sentence(ball_model, tmp_path):
    folder = write_model(ball_model, tmp_path / "sparse/0")
    file = folder / "images.bin"
    file.write_bytes(file.read_bytes()[:200])
    with pytest.raises(InputError, match=r"images\.bin is damaged"):
        mesh_colmap(tmp_path)


def test_a_depth_map_cut_short_is_one_sentence(ball_model, tmp_path):
    folder = dense_workspace(ball_model, tmp_path)
    file = sorted((folder / "stereo/depth_maps").iterdir())[0]
    file.write_bytes(file.read_bytes()[:-10])
    with pytest.raises(InputError, match="cut short"):
        mesh_colmap(tmp_path)


def test_a_result_of_ours_is_replaced_and_another_program_s_folder_is_not(ball_model, tmp_path):
    write_model(ball_model, tmp_path / "sparse/0")
    mesh_colmap(tmp_path)
    mesh_colmap(tmp_path, options=SurfaceOptions(method="convex-hull"))
    said = json.loads((tmp_path / "mesh_semsfm" / "mesh.json").read_text())
    assert said["mesh"]["method"] == "convex-hull"
    (tmp_path / "theirs").mkdir()
    (tmp_path / "theirs/mesh.ply").write_text("theirs")
    with pytest.raises(UsageError, match="nothing is overwritten"):
        mesh_colmap(tmp_path, tmp_path / "theirs")


def test_the_command_prints_area_and_hull(ball_model, tmp_path, capsys):
    write_model(ball_model, tmp_path / "sparse/0")
    code = main(["mesh", "--colmap_path", str(tmp_path), "--surface.method", "convex-hull"])
    assert code == 0
    said = capsys.readouterr().err
    assert "convex hull: volume 13." in said  # 4/3 pi 1.5^3 = 14.1, less the caps between points
    assert "closed (convex-hull)" in said


def test_the_script_does_what_the_command_does(ball_model, tmp_path):
    write_model(ball_model, tmp_path / "w/sparse/0")
    mesh_colmap(tmp_path / "w", tmp_path / "out")
    script = [sys.executable, str(ROOT / "scripts/mesh_colmap.py"), str(tmp_path / "w")]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    subprocess.run(script, check=True, env=environment, capture_output=True)
    made = (tmp_path / "w/mesh_semsfm/mesh.ply").read_bytes()
    assert made == (tmp_path / "out/mesh.ply").read_bytes()


def test_one_s_own_project_is_a_colmap_folder_too(small_project, tmp_path):
    shutil.copytree(small_project, tmp_path / "p")
    record = mesh_colmap(tmp_path / "p")
    assert record.source == "fused.ply"
    assert_sound_file(tmp_path / "p/mesh_semsfm/mesh.ply")
    same = read_ply_cloud(tmp_path / "p/dense/fused.ply")
    assert record.num_points == len(same.points)


def test_a_parallel_model_with_its_images_gets_depth_maps(small_project, tmp_path):
    shutil.copytree(small_project / "sparse/0", tmp_path / "sparse/0")
    (tmp_path / "sparse/0/orthographic.json").unlink()
    shutil.copytree(small_project / "images", tmp_path / "images")
    record = mesh_colmap(tmp_path)
    assert "depth maps of our own" in record.source
    assert "without the cameras' part" in record.sigma
    assert any("depth-reversed twin" in note for note in record.mesh.notes)
    textured = trimesh.load(tmp_path / "mesh_semsfm/mesh.glb", force="mesh")
    assert textured.visual.material.baseColorTexture is not None
    assert_sound_file(tmp_path / "mesh_semsfm/mesh.ply")
    (tmp_path / "images").rename(tmp_path / "elsewhere")
    sparse = mesh_colmap(tmp_path)
    assert sparse.source == "sparse points"
    assert not (tmp_path / "mesh_semsfm/mesh.glb").exists()
    assert record.num_points > 3 * sparse.num_points


def test_every_mesh_says_what_its_error_bars_hold(ball_model, tmp_path, capsys):
    write_model(ball_model, tmp_path / "points/sparse/0")
    record = mesh_colmap(tmp_path / "points")
    assert "triangulation" in record.sigma
    assert sigma_of(tmp_path / "points").shape == (record.mesh.num_vertices,)
    dense_workspace(ball_model, tmp_path / "maps")
    record = mesh_colmap(tmp_path / "maps")
    assert "spread of the depth maps" in record.sigma
    assert 0.0 < np.median(sigma_of(tmp_path / "maps")) < 0.01 * RADIUS
    points = ball(6000, seed=5)
    cloud = PointCloud(points=points, normals=points / RADIUS)
    write_ply(tmp_path / "maps/fused.ply", cloud)
    assert "spread of the depth maps" in mesh_colmap(tmp_path / "maps").sigma
    shutil.rmtree(tmp_path / "maps/stereo")
    assert main(["mesh", "--colmap_path", str(tmp_path / "maps")]) == 0
    assert "sigma of the vertices: none: fused.ply tells of no errors" in capsys.readouterr().err
    assert sigma_of(tmp_path / "maps") is None


def sigma_of(folder: Path):
    return read_ply_mesh(folder / "mesh_semsfm" / "mesh.ply").vertex_sigma
