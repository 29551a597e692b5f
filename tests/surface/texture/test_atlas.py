"""Textures from images, against scenes whose greys are known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
import pytest

from semsfm_colmap.errors import UsageError
from semsfm_colmap.surface.mesh.preview import render_mesh
from semsfm_colmap.surface.options import SurfaceOptions
from semsfm_colmap.surface.shading import Shading
from semsfm_colmap.surface.stereo.undrift import without_drift
from semsfm_colmap.surface.texture.atlas import (
    frontal_weights,
    simplify,
    texture_mesh,
    view_cosines,
)
from semsfm_colmap.surface.texture.texture_kernels import rasterize
from semsfm_colmap.types import Float, Int, Reconstruction, TriangleMesh
from tests.surface.mesh.test_repair import grid
from tests.surface.scene import (
    HEIGHT,
    RADIUS,
    WIDTH,
    ball_depth,
    pixel_rays,
    plane_depth,
    reconstruction_of,
    turning_cameras,
    write_pictures,
)
from tests.surface.texture.test_charts import ball


def sheet(n: int = 9, half_width: float = 2.0, z: float = 0.0) -> TriangleMesh:
    """A square in the plane z, around the origin, that faces the camera at angle 0."""
    vertices, faces = grid(n)
    vertices = 2 * half_width * (vertices / (n - 1) - [0.5, 0.5, 0.0]) + [0.0, 0.0, z]
    return TriangleMesh(vertices=vertices, faces=faces[:, ::-1])


def test_every_texel_of_a_square_belongs_to_a_face_and_knows_where() -> None:
    uv = np.array([[[2.0, 2], [10, 2], [2, 10]], [[10, 2], [10, 10], [2, 10]]])
    face, bary = rasterize(uv, 12, 12, 0.0)
    y, x = np.nonzero(face >= 0)
    assert {*x.tolist()} == {*y.tolist()} == set(range(2, 10))
    b = bary[y, x].astype(float)
    weights = np.column_stack([1 - b.sum(axis=1), b])
    place = np.einsum("nk,nki->ni", weights, uv[face[y, x]])
    np.testing.assert_allclose(place, np.column_stack([x, y]) + 0.5, atol=1e-5)


def test_charts_get_a_border_that_never_covers_a_face() -> None:
    uv = np.array([[[2.0, 2], [6, 2], [2, 6]], [[8, 8], [8, 4], [4, 8]]])
    bare = rasterize(uv, 12, 12, 0.0)[0]
    bordered = rasterize(uv, 12, 12, 2.0)[0]
    assert (bordered >= 0).sum() > (bare >= 0).sum() + 20
    np.testing.assert_array_equal(bordered[bare >= 0], bare[bare >= 0])


def test_what_another_surface_hides_has_no_weight() -> None:
    back, front = sheet(), sheet(half_width=1.0, z=-1.0)
    both = TriangleMesh(
        vertices=np.concatenate([back.vertices, front.vertices]),
        faces=np.concatenate([back.faces, front.faces + len(back.vertices)]),
    )
    cameras = turning_cameras([0.0, 180.0])
    reconstruction = reconstruction_of(cameras, ("a", "b"), np.zeros((1, 3)))
    cosine = view_cosines(both, reconstruction, 0.05)
    behind = np.abs(back.vertices[:, :2]).max(axis=1) < 0.95
    beside = np.abs(back.vertices[:, :2]).max(axis=1) > 1.05
    num = len(back.vertices)
    assert (cosine[0, :num][behind] == 0).all()
    assert (cosine[0, :num][beside] == 1).all()
    assert (cosine[0, num:] == 1).all()
    assert (cosine[1] == 0).all()


def test_the_most_frontal_image_counts_most() -> None:
    reconstruction = reconstruction_of(
        turning_cameras([0.0, 10.0, 40.0]), ("a", "b", "c"), np.zeros((1, 3))
    )
    weight = frontal_weights(view_cosines(sheet(half_width=1.0), reconstruction, 0.05))
    np.testing.assert_allclose(weight[0], 1.0)
    np.testing.assert_allclose(weight[1], np.cos(np.radians(10.0)) ** 12, rtol=1e-4)
    assert weight[2].max() < 0.05


@pytest.mark.parametrize("kind", ["albedo", "image"])
def test_the_texture_shows_what_the_images_show(
    tmp_path: Path, kind: Literal["albedo", "image"]
) -> None:
    cameras = turning_cameras([-10.0, 0.0, 10.0])
    normal = np.array([0.0, 0.0, -1.0])
    depths = [plane_depth(cameras, i, normal) for i in range(3)]
    names = write_pictures(tmp_path, cameras, depths, noise=0.0)
    # one image darker than the others
    dark = cv2.imread(str(tmp_path / names[0]), cv2.IMREAD_GRAYSCALE)
    assert cv2.imwrite(str(tmp_path / names[0]), np.rint(0.7 * dark).astype(np.uint8))
    reconstruction = reconstruction_of(cameras, names, np.zeros((1, 3)))
    textured, shading = texture_mesh(
        sheet(), reconstruction, tmp_path, SurfaceOptions(texture=kind)
    )
    # of a plane images show gain and law as one factor
    seen = cameras.cam_from_world @ normal
    factor = [shading.factor(i, seen[i]) for i in range(3)]
    np.testing.assert_allclose(factor[0] / factor[1:], 0.7, rtol=0.02)
    assert textured.uv is not None
    assert textured.texture is not None
    assert 0 <= textured.uv.min() <= textured.uv.max() <= 1

    # seen from the front, a render of the sheet (4 units, 80 px) is a cut-out of the picture
    shown = render_mesh(textured, size_px=(88, 88), use_colors=True, supersampling=1)[8:80, 8:80, 0]
    picture = cv2.imread(str(tmp_path / names[1]), cv2.IMREAD_GRAYSCALE)

    def likeness(dx: int) -> float:
        row, column = HEIGHT // 2 - 36, WIDTH // 2 - 36 + dx
        cut = picture[row : row + 72, column : column + 72]
        return float(np.corrcoef(shown.ravel(), cut.ravel())[0, 1])

    assert likeness(0) > 0.98
    assert likeness(0) > likeness(1) + 0.05
    assert likeness(0) > likeness(-1) + 0.05


def test_an_even_ball_has_an_even_albedo_and_light_and_dark_sides_as_an_image(
    tmp_path: Path,
) -> None:
    law = Shading(gradient=np.array([0.3, -0.5, 0.6]), gain=np.array([0.9, 1.0, 1.1, 1.0, 0.95]))
    cameras = turning_cameras([-60.0, -30.0, 0.0, 30.0, 60.0])
    names = tuple(f"{i}.png" for i in range(5))
    for i, name in enumerate(names):
        start, direction = pixel_rays(cameras, i)
        place = start + (ball_depth(cameras, i) - start @ direction)[..., None] * direction
        grey = 100.0 * law.factor(i, place / RADIUS @ cameras.cam_from_world[i].T)
        assert cv2.imwrite(str(tmp_path / name), np.rint(np.nan_to_num(grey)).astype(np.uint8))
    vertices, faces = ball()
    vertices = RADIUS * vertices / np.linalg.norm(vertices, axis=1, keepdims=True)
    front = vertices[faces].mean(axis=1)[:, 2] < -0.3 * RADIUS  # what several images see well
    mesh = TriangleMesh(vertices=vertices, faces=faces[front])
    reconstruction = reconstruction_of(cameras, names, np.zeros((1, 3)))

    spread = {}
    for kind in ("albedo", "image"):
        options = SurfaceOptions(texture=kind)
        textured, found = texture_mesh(mesh, reconstruction, tmp_path, options)
        shown = render_mesh(textured, size_px=(90, 90), use_colors=True, supersampling=1)[..., 0]
        grey = shown[shown < 255].astype(float)
        spread[kind] = float(np.std(grey) / np.mean(grey))
        if kind == "albedo":
            np.testing.assert_allclose(found.gradient, law.gradient, atol=0.05)
            np.testing.assert_allclose(found.gain / found.gain[1], law.gain, rtol=0.02)
    assert spread["albedo"] < 0.03
    assert spread["image"] > 0.1


def test_images_are_sampled_where_the_drift_has_taken_what_they_show(tmp_path: Path) -> None:
    cameras = turning_cameras([0.0])
    names = write_pictures(
        tmp_path, cameras, [plane_depth(cameras, 0, np.array([0.0, 0.0, -1.0]))], noise=0.0
    )
    straight = reconstruction_of(cameras, names, np.zeros((1, 3)))
    expected, _ = texture_mesh(sheet(), straight, tmp_path, SurfaceOptions())
    drift = (6.0, -4.0)
    path = str(tmp_path / names[0])
    # without_drift undoes a drift; the opposite one, to first order, brings it in
    moved = without_drift(
        cv2.imread(path, cv2.IMREAD_GRAYSCALE).astype(np.float32), (-drift[0], -drift[1])
    )
    assert cv2.imwrite(path, np.clip(np.rint(moved), 0, 255).astype(np.uint8))

    def likeness(reconstruction: Reconstruction) -> float:
        found, _ = texture_mesh(sheet(), reconstruction, tmp_path, SurfaceOptions())
        assert found.texture is not None
        assert expected.texture is not None
        return float(np.corrcoef(found.texture.ravel(), expected.texture.ravel())[0, 1])

    assert likeness(replace(straight, drift_px=np.array([drift]))) > 0.98
    assert likeness(straight) < 0.95


def test_a_face_no_image_sees_keeps_its_vertex_colour(tmp_path: Path) -> None:
    cameras = turning_cameras([180.0, 170.0])
    names = write_pictures(
        tmp_path, cameras, [plane_depth(cameras, i, np.array([0.0, 0.0, 1.0])) for i in range(2)]
    )
    mesh = sheet(4)
    colored = TriangleMesh(
        vertices=mesh.vertices,
        faces=mesh.faces,
        vertex_colors=np.full((len(mesh.vertices), 3), 91, dtype=np.uint8),
    )
    reconstruction = reconstruction_of(cameras, names, np.zeros((1, 3)))
    textured, _ = texture_mesh(colored, reconstruction, tmp_path, SurfaceOptions())
    shown = render_mesh(textured, size_px=(60, 60), use_colors=True)
    np.testing.assert_array_equal(shown[30, 30], 91)


def test_a_large_mesh_is_reduced_and_keeps_its_shape_and_colours() -> None:
    vertices, faces = grid(40)
    colors = np.repeat((vertices[:, :1] * 6).astype(np.uint8), 3, axis=1)
    small = simplify(TriangleMesh(vertices=vertices, faces=faces, vertex_colors=colors), 500)
    assert 100 < len(small.faces) <= 500
    np.testing.assert_allclose(small.vertices[:, 2], 0.0, atol=1e-9)
    assert small.vertex_colors is not None
    assert np.abs(small.vertex_colors[:, 0] - 6 * small.vertices[:, 0]).max() < 7
    assert simplify(small, 500) is small


def test_a_mesh_without_faces_is_misuse(tmp_path: Path) -> None:
    empty: tuple[Float, Int] = (np.zeros((3, 3)), np.zeros((0, 3), dtype=np.int64))
    reconstruction = reconstruction_of(turning_cameras([0.0]), ("a",), np.zeros((1, 3)))
    with pytest.raises(UsageError, match="no faces"):
        texture_mesh(
            TriangleMesh(vertices=empty[0], faces=empty[1]),
            reconstruction,
            tmp_path,
            SurfaceOptions(),
        )
