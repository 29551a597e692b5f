from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.report.inputs import ViewerInputs
from semsfm_colmap.report.options import ReportOptions
from semsfm_colmap.report.viewer.fit import fitting_scene
from semsfm_colmap.report.viewer.packing import as_text, unpack
from semsfm_colmap.report.viewer.pictures import series_pictures
from semsfm_colmap.report.viewer.scene import FIRST_VIEW, build_scene
from semsfm_colmap.types import PointCloud
from tests.report.series import cube, empty_reconstruction, make_inputs, make_reconstruction, sphere

REC = make_reconstruction(np.arange(12) * 15.0)


def textured(mesh):
    """Every face its own piece of a grey picture."""
    rng = np.random.default_rng(1)
    return replace(
        mesh,
        uv=rng.random((len(mesh.faces), 3, 2)),
        texture=np.repeat(rng.integers(0, 256, (16, 16, 1)), 3, axis=2).astype(np.uint8),
    )


def layers(scene):
    return {layer["name"]: layer for layer in scene.header["layers"]}


def test_the_first_view_shows_right_and_down_of_the_first_image():
    scene = build_scene(make_inputs(REC))
    view = scene.header["views"][0]
    assert view["name"] == FIRST_VIEW
    right, up, back = np.array(view["right_up_back"]).reshape(3, 3)
    R = REC.cameras.cam_from_world[0]
    np.testing.assert_allclose([right, -up, -back], R, atol=1e-12)


def test_every_view_is_a_right_handed_frame():
    for view in build_scene(make_inputs(REC)).header["views"]:
        m = np.array(view["right_up_back"]).reshape(3, 3)
        np.testing.assert_allclose(m @ m.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(m) == pytest.approx(1.0)


def test_the_corners_of_an_image_lie_where_the_camera_projects_them():
    scene = build_scene(make_inputs(REC))
    for k, frame in enumerate(scene.header["frames"]):
        corners = scene.arrays["frame.corner"][k].astype(np.float64)
        uv = REC.cameras.project(corners, np.full(4, frame["image"]))
        width, height = REC.image_size_px[frame["image"]]
        expected = [[0, 0], [width, 0], [width, height], [0, height]]
        np.testing.assert_allclose(uv, expected, atol=1e-3)


def test_points_are_coloured_by_what_is_known_of_them():
    scene = build_scene(make_inputs(REC))
    assert layers(scene)["points"]["values"] == ["views", "residual"]
    some = scene.arrays["points.views"]
    np.testing.assert_array_equal(some, REC.track_length()[REC.track_length() > 0])
    residual = np.linalg.norm(REC.residuals()[REC.inlier], axis=1)
    mean = np.sqrt(np.mean(residual**2) / 2.0)
    weighted = np.average(np.square(scene.arrays["points.residual"]), weights=some)
    assert np.sqrt(weighted) == pytest.approx(mean, rel=1e-5, abs=1e-12)
    known = replace(
        REC, point_covariance=np.tile(np.diag([1.0, 4.0, 9.0]), (len(REC.points), 1, 1))
    )
    scene = build_scene(make_inputs(known))
    np.testing.assert_allclose(scene.arrays["points.sigma"], 3.0)


def test_the_surface_is_what_is_shown_first():
    cloud = PointCloud(points=np.array(REC.points) * 1.01)
    scene = build_scene(make_inputs(REC, mesh=cube(), cloud=cloud))
    assert {name: layer["shown"] for name, layer in layers(scene).items()} == {
        "mesh": True, "cloud": False, "points": False,
    }  # fmt: skip
    scene = build_scene(make_inputs(REC, cloud=cloud))
    assert {name: layer["shown"] for name, layer in layers(scene).items()} == {
        "cloud": True, "points": False,
    }  # fmt: skip


def test_stray_points_do_not_shrink_the_object_and_unseen_ones_are_not_drawn():
    points = np.array(REC.points)
    points[:3] *= 1000.0
    scene = build_scene(make_inputs(replace(REC, points=points)))
    assert len(scene.arrays["points.position"]) == len(points) - 3
    assert any("3 far from the object left out" in remark for remark in scene.remarks)
    scene = build_scene(make_inputs(replace(REC, inlier=REC.observations.track_idx >= 10)))
    assert len(scene.arrays["points.position"]) == len(REC.points) - 10


def test_places_are_vertices_of_the_measured_mesh_in_full_precision():
    mesh = sphere()
    fine = replace(mesh, vertices=mesh.vertices.astype(np.float32).astype(np.float64))
    drawn = textured(sphere(20))
    inputs = make_inputs(REC, mesh=fine, viewer=ViewerInputs(textured=drawn))
    scene = build_scene(inputs)
    ids, where = scene.arrays["place.id"], scene.arrays["place.position"]
    assert 0.5 * len(drawn.vertices) < len(ids) <= len(drawn.vertices)
    np.testing.assert_array_equal(where, fine.vertices[ids].astype(np.float32))
    # each drawn vertex has one nearby
    for v in drawn.vertices[::37]:
        nearest = np.linalg.norm(where - v, axis=1).min()
        assert nearest == pytest.approx(np.linalg.norm(fine.vertices - v, axis=1).min(), abs=1e-6)
    live = build_scene(inputs, live=True)
    np.testing.assert_array_equal(live.arrays["place.id"], np.arange(len(fine.vertices)))
    assert {"mesh", "full"} <= set(layers(live))


def test_far_from_the_origin_places_are_kept_about_a_centre():
    mesh = sphere(30)
    shift = np.array([5e6, 4e6, 100.0])
    far = replace(mesh, vertices=mesh.vertices + shift)
    scene = build_scene(make_inputs(empty_reconstruction(0), mesh=far))
    back = scene.arrays["place.position"].astype(np.float64) + scene.header["origin"]
    expected = far.vertices[scene.arrays["place.id"]]
    assert np.abs(back - expected).max() < 1e-6


def test_texture_coordinates_are_of_the_corners_and_begin_at_the_top():
    drawn = textured(cube())
    scene = build_scene(make_inputs(REC, mesh=cube(), viewer=ViewerInputs(textured=drawn)))
    face = scene.arrays["mesh.face"]
    uv = scene.arrays["mesh.uv"][face] / 65535.0
    np.testing.assert_allclose(uv[..., 0], drawn.uv[..., 0], atol=1e-5)
    np.testing.assert_allclose(uv[..., 1], 1.0 - drawn.uv[..., 1], atol=1e-5)
    np.testing.assert_allclose(scene.arrays["mesh.position"][face], drawn.vertices[drawn.faces])
    assert scene.header["texture"] == "image/jpeg"


def test_a_texture_of_another_surface_is_not_shown():
    other = textured(replace(sphere(), vertices=3.0 * sphere().vertices))
    scene = build_scene(make_inputs(REC, mesh=sphere(), viewer=ViewerInputs(textured=other)))
    assert "texture" not in scene.header
    assert np.linalg.norm(scene.arrays["mesh.position"], axis=1).max() < 1.01


def test_labels_and_numbers_of_views_are_those_of_the_nearest_vertices():
    mesh = cube()
    viewer = ViewerInputs(
        labels=np.arange(8) % 2,
        label_names={"specimen": 0, "coil": 1},
        seen=lambda ids: ((ids[:, None] > np.arange(12)) * 1, np.ones((len(ids), 12))),
    )
    scene = build_scene(make_inputs(REC, mesh=mesh, viewer=viewer))
    assert scene.header["labels"] == {"0": "specimen", "1": "coil"}
    np.testing.assert_array_equal(scene.arrays["mesh.label"], np.arange(8) % 2)
    np.testing.assert_array_equal(scene.arrays["mesh.views"], np.arange(8))


def test_points_and_faces_are_thinned_to_the_limits():
    options = ReportOptions(max_scene_points=100, max_scene_faces=1000)
    extent = float(np.ptp(REC.points))
    large = replace(sphere(), vertices=extent * sphere().vertices)
    scene = build_scene(make_inputs(REC, mesh=large), options)
    assert len(scene.arrays["points.position"]) == 100
    assert len(scene.arrays["mesh.face"]) <= 1000
    assert scene.remarks[1] == "Points: 100 of 400."
    assert "without texture" in scene.remarks[0]


def test_a_scene_fits_into_the_room_that_a_page_has():
    inputs = make_inputs(REC, mesh=textured(sphere(80)))
    full = fitting_scene(inputs, ReportOptions(), 10_000_000)
    size = len(as_text(full.packed))
    assert full.header["texture"]
    small = fitting_scene(inputs, ReportOptions(), size // 3)
    assert len(as_text(small.packed)) <= size // 3
    assert len(small.arrays["mesh.face"]) > 2000
    assert fitting_scene(inputs, ReportOptions(), 0) is None


def test_pictures_of_the_series_stay_within_their_room_and_are_all_of_one_size():
    rng = np.random.default_rng(0)
    noise = {f"{k}": rng.integers(0, 256, (300, 400)).astype(np.uint8) for k in range(5)}
    found = series_pictures([*noise, "gone"], noise.get, 60_000)
    assert found[-1] is None
    assert 20_000 < sum(len(data) for data in found[:-1]) <= 60_000
    assert series_pictures(list(noise), noise.get, 100) == [None] * 5


def test_names_that_turn_the_direction_of_writing_are_shown_as_escapes_and_found_as_they_are():
    name = "a\u202efit.bad"
    rec = replace(REC, image_names=(name, *REC.image_names[1:]))
    read = []

    def picture(asked):
        read.append(asked)
        return np.zeros((30, 40), dtype=np.uint8)

    viewer = ViewerInputs(picture=picture, label_names={"x\u202ey": 1})
    scene = build_scene(replace(make_inputs(rec), viewer=viewer), max_picture_bytes=60_000)
    assert scene.header["frames"][0]["name"] == "a\\u202efit.bad"
    assert scene.header["labels"] == {"1": "x\\u202ey"}
    assert name in read


def test_a_mesh_alone_is_shown_and_nothing_makes_no_scene():
    scene = build_scene(make_inputs(empty_reconstruction(0), mesh=cube()))
    assert list(layers(scene)) == ["mesh"]
    assert "frames" not in scene.header
    assert build_scene(make_inputs(empty_reconstruction(2))) is None


def test_what_is_packed_is_what_was_gathered():
    scene = build_scene(make_inputs(REC, mesh=cube()))
    header, arrays = unpack(scene.packed)
    assert header["layers"] == scene.header["layers"]
    assert set(arrays) == set(scene.arrays)
