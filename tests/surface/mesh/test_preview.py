"""Pictures of meshes and clouds."""

from __future__ import annotations

import numpy as np
import pytest

from semsfm_colmap.errors import UsageError
from semsfm_colmap.surface.mesh.preview import (
    BACKGROUND,
    INSIDE_COLOR,
    render_mesh,
    turntable,
)
from semsfm_colmap.types import TriangleMesh

SIZE = (90, 60)


def square(z: float = 0.0, facing: float = -1.0) -> TriangleMesh:
    vertices = np.array([[0.0, 0, z], [1, 0, z], [1, 1, z], [0, 1, z]])
    faces = np.array([[0, 2, 1], [0, 3, 2]])
    texture = np.zeros((4, 4, 3), dtype=np.uint8)
    texture[:2] = 240
    return TriangleMesh(
        vertices=vertices,
        faces=faces if facing < 0 else faces[:, ::-1],
        uv=vertices[faces][:, :, :2],
        texture=texture,
        vertex_colors=np.full((4, 3), 77, dtype=np.uint8),
    )


def test_the_picture_is_fitted_around_the_mesh() -> None:
    picture = render_mesh(square(), size_px=SIZE)
    assert picture.shape == (60, 90, 3)
    assert picture.dtype == np.uint8
    np.testing.assert_array_equal(picture[:, [0, -1]], np.full((60, 2, 3), BACKGROUND))
    rows, columns = np.nonzero((picture != BACKGROUND).any(axis=2))
    assert abs((rows.max() - rows.min()) - (columns.max() - columns.min())) <= 1
    assert rows.min() + rows.max() == 59
    assert 53 <= rows.max() - rows.min() + 1 <= 55


def test_a_face_seen_from_inside_is_tinted() -> None:
    outside = render_mesh(square(), size_px=SIZE)[30, 45].astype(int)
    inside = render_mesh(square(facing=1.0), size_px=SIZE)[30, 45].astype(int)
    assert abs(outside[0] - outside[2]) < 10
    ratio = inside / np.array(INSIDE_COLOR)
    assert ratio.max() - ratio.min() < 0.03


def test_the_side_toward_the_light_is_brighter() -> None:
    roof = TriangleMesh(
        vertices=np.array(
            [[-1.0, -1, 0.5], [-1, 1, 0.5], [0, -1, 0], [0, 1, 0], [1, -1, 0.5], [1, 1, 0.5]]
        ),
        faces=np.array([[0, 1, 2], [1, 3, 2], [2, 3, 4], [3, 5, 4]]),
    )
    picture = render_mesh(roof, size_px=SIZE, smooth=False)
    assert int(picture[30, 30, 0]) > int(picture[30, 60, 0]) + 20


def test_texture_and_vertex_colours_are_shown_unshaded() -> None:
    textured = render_mesh(square(), size_px=SIZE, use_colors=True)
    # v = 0 is the texture's last row and y = 0, which an image has at its top
    assert textured[12, 45, 0] == 0
    assert textured[48, 45, 0] == 240
    plain = TriangleMesh(
        vertices=square().vertices, faces=square().faces, vertex_colors=square().vertex_colors
    )
    assert render_mesh(plain, size_px=SIZE, use_colors=True)[30, 45, 0] == 77


def test_the_nearer_surface_hides_the_farther_one() -> None:
    near, far = square(-1.0), square(1.0)
    both = TriangleMesh(
        vertices=np.concatenate([far.vertices, near.vertices]),
        faces=np.concatenate([far.faces, near.faces + 4]),
        vertex_colors=np.repeat(np.array([[10] * 3, [200] * 3], np.uint8), 4, axis=0),
    )
    assert render_mesh(both, size_px=SIZE, use_colors=True)[30, 45, 0] == 200
    turned = turntable(np.eye(3), np.array([180.0]))[0]
    back = TriangleMesh(
        vertices=both.vertices, faces=both.faces[:, ::-1], vertex_colors=both.vertex_colors
    )
    assert render_mesh(back, turned, size_px=SIZE, use_colors=True)[30, 45, 0] == 10


def test_a_turntable_turns_about_the_upright_axis_of_the_image() -> None:
    views = turntable(np.eye(3), np.array([0.0, 90.0]))
    np.testing.assert_allclose(views[0], np.eye(3))
    np.testing.assert_allclose(views[1] @ [0, 1, 0], [0, 1, 0], atol=1e-12)
    np.testing.assert_allclose(views[1] @ [0, 0, 1], [1, 0, 0], atol=1e-12)


def test_nothing_to_render_is_misuse() -> None:
    with pytest.raises(UsageError, match="no faces"):
        render_mesh(TriangleMesh(vertices=np.eye(3), faces=np.zeros((0, 3), dtype=np.int64)))
