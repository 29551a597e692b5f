"""Charts: whole, flat enough, never on top of themselves, and packed apart."""

from __future__ import annotations

import numpy as np
import pytest

from semsfm_colmap.errors import UsageError
from semsfm_colmap.geometry.mesh_normals import face_normals
from semsfm_colmap.surface.mesh.halfedges import component_labels, opposite_halfedge
from semsfm_colmap.surface.texture.chart_kernels import smooth_labels
from semsfm_colmap.surface.texture.charts import make_atlas, make_charts, project_charts
from semsfm_colmap.types import Bool, Float, Int
from tests.surface.mesh.test_repair import grid


def ball(num: int = 24) -> tuple[Float, Int]:
    """A bumpy closed surface: longitudes and latitudes, with caps of triangles."""
    angle = 2 * np.pi * np.arange(2 * num) / (2 * num)
    height = np.pi * (np.arange(1, num) / num)
    h, a = np.meshgrid(height, angle, indexing="ij")
    r = 20.0 + np.sin(5 * a) * np.sin(4 * h)
    ring = np.stack([r * np.sin(h) * np.cos(a), r * np.sin(h) * np.sin(a), r * np.cos(h)], axis=-1)
    vertices = np.concatenate([ring.reshape(-1, 3), [[0.0, 0, 20], [0, 0, -20]]])
    rows, columns = h.shape
    i, j = np.meshgrid(np.arange(rows - 1), np.arange(columns), indexing="ij")
    a0, b0 = i * columns + j, i * columns + (j + 1) % columns
    a1, b1 = a0 + columns, b0 + columns
    side = np.stack([np.stack([a0, a1, b1], -1), np.stack([a0, b1, b0], -1)]).reshape(-1, 3)
    j = np.arange(columns)
    last = (rows - 1) * columns
    top = np.stack([np.full(columns, len(vertices) - 2), j, (j + 1) % columns], axis=1)
    bottom = np.stack(
        [np.full(columns, len(vertices) - 1), last + (j + 1) % columns, last + j], axis=1
    )
    return vertices, np.concatenate([side, top, bottom])


def ramp(turns: float, num: int = 120) -> tuple[Float, Int]:
    """A spiral ramp around the z axis: level all over, and above itself after one turn."""
    angle = np.linspace(0, 2 * np.pi * turns, num)
    inner, outer = (
        np.stack([r * np.cos(angle), r * np.sin(angle), 0.3 * angle], axis=1) for r in (5.0, 15.0)
    )
    i = np.arange(num - 1)
    faces = np.concatenate(
        [np.stack([i, i + num, i + num + 1], axis=1), np.stack([i, i + num + 1, i + 1], axis=1)]
    )
    return np.concatenate([inner, outer]), faces


def covered(corners: Float, x: Float, y: Float) -> Bool:
    """Which points (P,) lie inside a triangle (3, 2), by the signs of three areas."""
    sign = []
    for k in range(3):
        a, b = corners[k], corners[(k + 1) % 3]
        sign.append((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0]))
    return np.asarray((np.min(sign, axis=0) > 1e-6) | (np.max(sign, axis=0) < -1e-6))


def most_faces_over_a_texel(corners: Float) -> int:
    """Of triangles (F, 3, 2), counted at the centres of texels one by one."""
    low, high = np.floor(corners.min(axis=(0, 1))), np.ceil(corners.max(axis=(0, 1)))
    x, y = np.meshgrid(np.arange(low[0], high[0]) + 0.5, np.arange(low[1], high[1]) + 0.5)
    return int(np.max(sum(covered(c, x, y).astype(int) for c in corners)))


def test_a_chart_is_connected_and_covers_no_texel_twice() -> None:
    for vertices, faces in (ball(), ramp(2.5)):
        chart = make_charts(vertices, faces, 1.0)
        assert set(chart) == set(range(chart.max() + 1))
        flat = project_charts(vertices, faces, chart)
        for c in range(chart.max() + 1):
            assert component_labels(faces[chart == c]).max() == 0
            assert most_faces_over_a_texel(flat[chart == c]) == 1


def test_a_flat_sheet_is_one_chart_in_its_true_size() -> None:
    vertices, faces = grid(12)
    chart = make_charts(vertices, faces, 0.25)
    np.testing.assert_array_equal(chart, 0)
    flat = project_charts(vertices, faces, chart)
    e1, e2 = flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]
    np.testing.assert_allclose(e1[:, 0] * e2[:, 1] - e1[:, 1] * e2[:, 0], 1.0)


def test_a_ramp_of_one_turn_is_one_chart_and_one_of_two_turns_is_not() -> None:
    assert make_charts(*ramp(0.95), 1.0).max() == 0
    assert make_charts(*ramp(1.95), 1.0).max() >= 1


def test_no_face_loses_more_than_the_bound_and_none_is_mirrored() -> None:
    vertices, faces = ball()
    flat = project_charts(vertices, faces, make_charts(vertices, faces, 1.0))
    e1, e2 = flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]
    area = e1[:, 0] * e2[:, 1] - e1[:, 1] * e2[:, 0]
    share = area / np.linalg.norm(face_normals(vertices, faces), axis=1)
    assert 0.2 <= share.min() <= share.max() <= 1.0 + 1e-9
    assert np.mean(share) > 0.85


def test_noise_does_not_break_a_sheet_into_crumbs() -> None:
    vertices, faces = grid(40)
    vertices = vertices + np.random.default_rng(1).normal(0, 0.25, vertices.shape) * [0, 0, 1]
    assert make_charts(vertices, faces, 1.0).max() < 5


def test_a_face_without_area_takes_part() -> None:
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])
    faces = np.array([[0, 1, 2], [1, 3, 2], [1, 1, 3]])
    uv, _ = make_atlas(vertices, faces, 0.1, 256)
    assert uv.shape == (3, 3, 2)
    assert np.isfinite(uv).all()


def test_charts_in_the_atlas_keep_their_size_and_their_distance() -> None:
    vertices, faces = ball()
    chart = make_charts(vertices, faces, 0.5)
    uv, (width, height) = make_atlas(vertices, faces, 0.5, 4096)
    assert 0 <= uv.min() <= uv.max() <= 1
    texels = uv * [width, height]
    flat = project_charts(vertices / 0.5, faces, chart)
    edge, true = (np.linalg.norm(c - np.roll(c, 1, axis=1), axis=2) for c in (texels, flat))
    # the packer stretches charts to whole texels
    assert np.abs(edge - true).max() < 1.0
    np.testing.assert_allclose(np.median(edge / true), 1.0, atol=0.02)
    owner = np.full((height, width), -1)
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    for f in range(len(faces)):
        owner[covered(texels[f], x, y)] = chart[f]
    for dx, dy in ((1, 0), (0, 1), (2, 0), (0, 2), (1, 1)):
        here = owner[: height - dy, : width - dx]
        there = owner[dy:, dx:]
        assert not ((here >= 0) & (there >= 0) & (here != there)).any()


def test_a_large_atlas_is_shrunk_to_what_is_asked_for() -> None:
    vertices, faces = ball()
    assert max(make_atlas(vertices, faces, 0.1, 4096)[1]) > 600
    assert 250 < max(make_atlas(vertices, faces, 0.1, 300)[1]) <= 300


def test_borders_that_do_not_fit_are_said() -> None:
    vertices, faces = ball()
    with pytest.raises(UsageError, match="charts of the mesh do not fit into a texture of 8 px"):
        make_atlas(vertices, faces, 0.1, 8)


def plain_labels(cosine: Float, neighbor: Int, agreement: float, least: float) -> Int:
    """The Potts model face by face: the label with the highest score, until none changes."""
    label = cosine.argmax(axis=1)
    while True:
        before = label.copy()
        for f, row in enumerate(cosine):
            same = [(label[neighbor[f][neighbor[f] >= 0]] == k).sum() for k in range(len(row))]
            score = np.where(row >= least, row + agreement * np.array(same), -np.inf)
            label[f] = label[f] if score[label[f]] >= score.max() else score.argmax()
        if (label == before).all():
            return label


def test_labels_are_those_of_the_plain_potts_model() -> None:
    _, faces = ball(8)
    rng = np.random.default_rng(3)
    opposite = opposite_halfedge(faces).reshape(-1, 3)
    neighbor = np.where(opposite >= 0, opposite // 3, -1)
    cosine = rng.uniform(-0.5, 1.0, (len(faces), 5))
    cosine[:, 0] = np.maximum(cosine[:, 0], 0.3)
    found = smooth_labels(cosine, neighbor, 0.4, 0.2, 100)
    np.testing.assert_array_equal(found, plain_labels(cosine, neighbor, 0.4, 0.2))
    assert len(set(found)) == 5
    assert (found != cosine.argmax(axis=1)).mean() > 0.1
