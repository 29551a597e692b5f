import numpy as np
import pytest

from semsfm_colmap.segmentation.labels import whole
from semsfm_colmap.segmentation.table import face_areas, parts_table
from semsfm_colmap.segmentation.transfer import face_labels, nearest_labels
from semsfm_colmap.synthetic.primitives import geodesic_sphere
from semsfm_colmap.types import TriangleMesh


def test_a_point_has_the_label_of_its_neighbourhood():
    points = np.random.default_rng(0).uniform(-1, 1, (3000, 3))
    at = np.random.default_rng(1).uniform(-1, 1, (300, 3))
    label = np.where(points[:, 0] > 0, 4, 1)
    found = nearest_labels(points, label, at)
    clear = np.abs(at[:, 0]) > 0.25
    assert np.array_equal(found[clear], np.where(at[clear, 0] > 0, 4, 1))
    # a point of the cloud itself weighs more than all others
    assert np.array_equal(nearest_labels(points, label, points), label)


@pytest.mark.parametrize("num", [1, 2])
def test_clouds_of_one_or_two_points_label_everything(num):
    at = np.array([[0.0, 0, 0], [np.nan, 0, 0]])
    assert nearest_labels(np.zeros((num, 3)), np.full(num, 3), at).tolist() == [3, 0]


def test_a_face_has_the_label_of_two_of_its_corners():
    rng = np.random.default_rng(0)
    label, faces = rng.integers(0, 3, 50), rng.integers(0, 50, (200, 3))
    for face, found in zip(label[faces], face_labels(label, faces), strict=True):
        values, count = np.unique(face, return_counts=True)
        assert found == (values[count.argmax()] if count.max() > 1 else face[0])


def test_the_table_adds_up_to_the_whole_ball():
    vertices, faces = geodesic_sphere(20)
    mesh = TriangleMesh(vertices=vertices, faces=faces)
    labelling = whole(len(vertices), "")
    label = np.where(vertices[:, 2] > 0.5, 2, 1)
    from dataclasses import replace

    rows = parts_table(replace(labelling, label=label), mesh, label, label[:7])
    assert [row["name"] for row in rows] == ["specimen", "coil"]
    assert sum(row["num_faces"] for row in rows) == len(faces)
    assert sum(row["num_points"] for row in rows) == len(vertices)
    assert sum(row["num_sparse_points"] for row in rows) == 7
    assert sum(row["area"] for row in rows) == pytest.approx(face_areas(mesh).sum())
    # a cap of height 1/2: pi
    assert rows[1]["area"] == pytest.approx(np.pi, rel=0.05)


def test_without_a_mesh_nothing_is_said_of_it():
    (row,) = parts_table(whole(5, ""), None, None, None)
    assert row["area"] is None
    assert row["num_faces"] is None
    assert row["num_sparse_points"] is None
