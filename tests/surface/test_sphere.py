"""A sphere seen by parallel rays: what the surface stage makes of it is known in closed form."""

import cv2
import numpy as np
import pytest

from semsfm_colmap.geometry.rotations import rotation_from_vector
from semsfm_colmap.surface.ball_pivoting import mesh_cloud
from semsfm_colmap.surface.cloud import sparse_cloud
from semsfm_colmap.surface.files import (
    DepthMapFolder,
    read_ply_cloud,
    read_ply_mesh,
    write_depth_map,
    write_ply,
    write_textured,
)
from semsfm_colmap.surface.normals import estimate_normals
from semsfm_colmap.surface.options import SurfaceOptions
from semsfm_colmap.surface.texture import texture_mesh
from semsfm_colmap.types import (
    DepthMap,
    Observations,
    OrthographicCameras,
    PointCloud,
    Reconstruction,
    TriangleMesh,
)

RADIUS = 100.0
SIZE = 320


def sphere_points(num: int) -> np.ndarray:
    k = np.arange(num) + 0.5
    z = 1.0 - 2.0 * k / num
    phi = np.pi * (1.0 + 5.0**0.5) * k
    r = np.sqrt(1.0 - z * z)
    return RADIUS * np.column_stack([r * np.cos(phi), r * np.sin(phi), z])


@pytest.fixture
def reconstruction() -> Reconstruction:
    """Twelve views all around, every point seen on the side that faces the viewer."""
    angles = 2.0 * np.pi * np.arange(12) / 12
    R = rotation_from_vector(angles[:, None] * np.array([0.0, 1.0, 0.0]))
    cameras = OrthographicCameras(
        cam_from_world=R,
        scale_px_per_unit=np.ones(12),
        translation_px=np.full((12, 2), SIZE / 2.0),
    )
    points = sphere_points(3000)
    seen = points @ R[:, 2].T < -0.2 * RADIUS
    seen &= seen.sum(axis=1, keepdims=True) >= 3
    track, image = np.nonzero(seen)
    used, track = np.unique(track, return_inverse=True)
    points = points[used]
    return Reconstruction(
        image_names=tuple(f"{i}.png" for i in range(12)),
        image_size_px=np.full((12, 2), SIZE),
        cameras=cameras,
        points=points,
        observations=Observations(
            image_idx=image,
            track_idx=track,
            keypoint_idx=np.arange(len(track)),
            xy=cameras.project(points[track], image),
            num_images=12,
            num_tracks=len(points),
        ),
        inlier=np.ones(len(track), dtype=bool),
        point_color=np.full((len(points), 3), 128, dtype=np.uint8),
    )


@pytest.fixture
def mesh(reconstruction) -> TriangleMesh:
    return mesh_cloud(sparse_cloud(reconstruction, SurfaceOptions()), SurfaceOptions())


def test_normals_of_a_sphere_point_outward(reconstruction):
    cloud = sparse_cloud(reconstruction, SurfaceOptions())
    outward = cloud.points / np.linalg.norm(cloud.points, axis=1, keepdims=True)
    agreement = np.sum(cloud.normals * outward, axis=1)
    assert np.mean(agreement > 0.9) > 0.98


def test_normals_of_a_plane_face_the_viewer():
    rng = np.random.default_rng(0)
    plane = np.column_stack([rng.uniform(-1, 1, (400, 2)), np.zeros(400)])
    normals = estimate_normals(plane, np.tile([0.0, 0.0, 1.0], (400, 1)))
    assert np.allclose(normals, [0.0, 0.0, -1.0], atol=1e-6)


def test_ball_pivoting_gives_one_clean_piece_at_the_right_radius(mesh):
    radius = np.linalg.norm(mesh.vertices, axis=1)
    assert np.all(np.abs(radius - RADIUS) < 0.03 * RADIUS)
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    assert np.mean(np.sum(normal * (a + b + c), axis=1) > 0) > 0.99
    area = 0.5 * np.linalg.norm(normal, axis=1).sum()
    # the poles are seen at too flat an angle; the rest of the sphere must be there
    assert 0.8 < area / (4.0 * np.pi * RADIUS**2) < 1.02
    edges = np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    _, count = np.unique(edges, axis=0, return_counts=True)
    assert count.max() <= 2


def test_clouds_and_meshes_come_back_from_ply(mesh, tmp_path):
    write_ply(tmp_path / "m.ply", mesh)
    back = read_ply_mesh(tmp_path / "m.ply")
    assert np.array_equal(back.faces, mesh.faces)
    assert np.allclose(back.vertices, mesh.vertices, atol=1e-4)
    cloud = PointCloud(
        points=mesh.vertices, normals=mesh.vertex_normals, sigma=np.full(len(mesh.vertices), 0.5)
    )
    write_ply(tmp_path / "c.ply", cloud)
    again = read_ply_cloud(tmp_path / "c.ply")
    assert np.allclose(again.normals, cloud.normals, atol=1e-6)
    assert np.allclose(again.sigma, 0.5)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["c.ply", "m.ply"]


def test_depth_maps_come_back_from_their_folder(tmp_path):
    rng = np.random.default_rng(0)
    maps = [
        DepthMap(image_name=f"{k}.png", depth=rng.normal(size=(8, 9)).astype(np.float32))
        for k in range(3)
    ]
    for depth_map in maps:
        write_depth_map(tmp_path, depth_map)
    folder = DepthMapFolder(tmp_path, [m.image_name for m in maps])
    assert len(folder) == 3
    assert np.array_equal(folder[1].depth, maps[1].depth)
    assert [m.image_name for m in folder[1:]] == ["1.png", "2.png"]


def test_the_texture_shows_what_the_images_show(mesh, reconstruction, tmp_path):
    # grey encodes the height in the image, which all views share: v = y + SIZE / 2
    rows = np.arange(SIZE, dtype=np.float64)[:, None] + 0.5
    image = np.repeat(np.clip(rows / SIZE * 255.0, 0, 255), SIZE, axis=1).astype(np.uint8)
    for name in reconstruction.image_names:
        cv2.imwrite(str(tmp_path / name), image)
    textured = texture_mesh(mesh, reconstruction, tmp_path, SurfaceOptions())
    assert textured.uv.shape == (len(textured.faces), 3, 2)
    height, width = textured.texture.shape[:2]
    uv = textured.uv.mean(axis=1)
    grey = textured.texture[
        ((1.0 - uv[:, 1]) * height).astype(int), (uv[:, 0] * width).astype(int), 0
    ].astype(float)
    y = textured.vertices[textured.faces].mean(axis=1)[:, 1]
    expected = (y + SIZE / 2.0) / SIZE * 255.0
    # gains between images are free, so the shades follow a line through the origin
    slope = np.median(grey / expected)
    assert 0.5 < slope < 2.0
    assert np.median(np.abs(grey / slope - expected)) < 4.0
    glb, obj = write_textured(textured, tmp_path)
    assert glb.stat().st_size > 10_000
    assert obj.is_file()
