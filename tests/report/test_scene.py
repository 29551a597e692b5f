import base64
from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.report.camera_frames import (
    find_view,
    frame_centers,
    frame_outlines,
    labelled_frames,
)
from semsfm_colmap.report.options import ReportOptions
from semsfm_colmap.report.scene import FIRST_VIEW, build_scene, packed, round_length
from semsfm_colmap.report.thinning import even_subset, thin_mesh, vertex_colors
from semsfm_colmap.types import PointCloud, TriangleMesh
from tests.report.series import cube, empty_reconstruction, make_inputs, make_reconstruction

REC = make_reconstruction(np.arange(12) * 15.0)


def unpacked(array):
    return np.frombuffer(base64.b64decode(array["bdata"]), dtype=f"<{array['dtype']}")


def points_of(trace):
    return np.stack([unpacked(trace[letter]) for letter in "xyz"], axis=1)


def vector(mapping):
    return np.array([mapping[letter] for letter in "xyz"])


def sphere(num_rings=120):
    theta = np.linspace(0.0, np.pi, num_rings)
    phi = np.linspace(0.0, 2.0 * np.pi, 2 * num_rings, endpoint=False)
    t, p = np.meshgrid(theta, phi, indexing="ij")
    vertices = np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], axis=-1)
    i, j = np.meshgrid(np.arange(num_rings - 1), np.arange(2 * num_rings), indexing="ij")
    k = (j + 1) % (2 * num_rings)
    n = 2 * num_rings
    quads = np.stack([i * n + j, (i + 1) * n + j, (i + 1) * n + k, i * n + k], axis=-1)
    quads = quads.reshape(-1, 4)
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return TriangleMesh(vertices=vertices.reshape(-1, 3), faces=faces)


def test_each_frame_stands_on_the_ray_through_the_centre_of_its_image():
    cameras = replace(REC.cameras, aspect=1.1, skew=0.05)
    centers = frame_centers(replace(REC, cameras=cameras), find_view(REC.points))
    uv = cameras.project(centers, np.arange(12))
    np.testing.assert_allclose(uv, 0.5 * REC.image_size_px, atol=1e-9)


def test_all_frames_stand_before_the_object_at_one_distance():
    view = find_view(REC.points)
    centers = frame_centers(REC, view)
    depth = np.einsum("ij,ij->i", REC.cameras.viewing_direction, centers - view.center)
    np.testing.assert_allclose(depth, depth[0])
    assert depth[0] < -view.radius


def test_the_mark_of_a_frame_is_at_the_top_of_its_image():
    outlines = frame_outlines(REC, find_view(REC.points))
    for i in range(12):
        uv = REC.cameras.project(outlines[i], np.full(8, i))
        assert np.argmin(uv[:, 1]) == 2
        assert uv[2, 0] == pytest.approx(0.5 * REC.image_size_px[i, 0])


def test_the_scene_opens_as_in_the_first_image():
    scene = build_scene(make_inputs(REC))
    assert scene is not None
    camera = scene.layout["scene"]["camera"]
    assert camera == scene.views[FIRST_VIEW].camera
    assert camera["projection"] == {"type": "orthographic"}
    eye, up = vector(camera["eye"]), vector(camera["up"])
    shown = points_of(scene.data[0]).astype(np.float64)
    # what a viewer at the eye sees to the right and downward are u and v of the first image
    uv = REC.cameras.project(shown, np.zeros(len(shown), dtype=np.int64))
    right = np.cross(up, eye) / np.linalg.norm(eye)
    size = REC.cameras.scale_px_per_unit[0]
    moved = uv - REC.cameras.translation_px[0]
    np.testing.assert_allclose(size * shown @ right, moved[:, 0], atol=1e-9)
    np.testing.assert_allclose(size * shown @ -up, moved[:, 1], atol=1e-9)


def test_the_ranges_hold_everything_around_the_centre():
    scene = build_scene(make_inputs(REC, mesh=cube()))
    assert scene is not None
    everything = np.concatenate([points_of(trace) for trace in scene.data])
    everything = everything[np.isfinite(everything).all(axis=1)]
    ranges = np.array([scene.layout["scene"][f"{letter}axis"]["range"] for letter in "xyz"])
    assert np.all(everything >= ranges[:, 0])
    assert np.all(everything <= ranges[:, 1])
    np.testing.assert_allclose(ranges.mean(axis=1), find_view(REC.points).center)


def test_stray_points_do_not_shrink_the_object():
    points = np.array(REC.points)
    points[:3] *= 1000.0
    scene = build_scene(make_inputs(replace(REC, points=points)))
    assert scene is not None
    assert len(points_of(scene.data[0])) == len(points) - 3
    assert any("3 far from the object left out" in remark for remark in scene.remarks)


def test_points_that_no_image_sees_are_not_drawn():
    inlier = REC.observations.track_idx >= 10
    scene = build_scene(make_inputs(replace(REC, inlier=inlier)))
    assert scene is not None
    assert len(points_of(scene.data[0])) == len(REC.points) - 10


def test_every_part_has_its_switch_and_starts_as_the_switch_says():
    cloud = PointCloud(points=np.array(REC.points) * 1.01)
    scene = build_scene(make_inputs(REC, mesh=cube(), cloud=cloud))
    assert scene is not None
    labels = [switch.label for switch in scene.switches]
    assert labels == ["points", "dense cloud", "mesh", "cameras", "axes"]
    traces = [k for switch in scene.switches for k in switch.traces]
    assert traces == list(range(len(scene.data)))
    for switch in scene.switches:
        for k in switch.traces:
            assert scene.data[k].get("visible", True) == switch.on


def test_points_and_faces_are_thinned_to_the_limits():
    options = ReportOptions(max_scene_points=100, max_scene_faces=1000)
    scene = build_scene(make_inputs(REC, mesh=sphere()), options)
    assert scene is not None
    assert len(points_of(scene.data[0])) == 100
    assert len(unpacked(scene.data[1]["i"])) <= 1000
    assert scene.remarks[0] == "Points: 100 of 400."


def test_a_mesh_alone_is_shown():
    scene = build_scene(make_inputs(empty_reconstruction(0), mesh=cube()))
    assert scene is not None
    assert [s.label for s in scene.switches if s.on] == ["mesh", "axes"]


def test_nothing_makes_no_scene():
    assert build_scene(make_inputs(empty_reconstruction(2))) is None


def test_thinning_a_mesh_stays_within_a_cell_of_the_surface():
    mesh = sphere()
    thin = thin_mesh(mesh, 5000)
    assert 2500 < len(thin.faces) <= 5000
    radius = np.linalg.norm(thin.vertices, axis=1)
    # 5000 faces on a sphere of area 4 pi are 0.07 long
    assert np.all(np.abs(radius - 1.0) < 0.02)
    assert thin.faces.max() == len(thin.vertices) - 1


def test_thinning_a_mesh_keeps_its_faces_turned_outward():
    thin = thin_mesh(sphere(), 5000)
    corner = thin.vertices[thin.faces]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    assert np.mean(np.einsum("ij,ij->i", normal, corner.mean(axis=1)) > 0.0) > 0.99


def test_a_small_mesh_is_left_as_it_is():
    thin = thin_mesh(cube(), 12)
    np.testing.assert_array_equal(thin.faces, cube().faces)


def test_vertex_colours_come_from_the_texture():
    texture = np.zeros((2, 2, 3), dtype=np.uint8)
    texture[0, 1] = (10, 20, 30)
    uv = np.tile([0.75, 0.75], (12, 3, 1))
    colors = vertex_colors(replace(cube(), uv=uv, texture=texture))
    np.testing.assert_array_equal(colors, np.tile([10, 20, 30], (8, 1)))


def test_an_even_subset_is_spread_evenly():
    idx = even_subset(100_000, 1000)
    assert len(idx) == len(np.unique(idx)) == 1000
    counts = np.histogram(idx, bins=20, range=(0, 100_000))[0]
    assert counts.min() >= 45
    assert counts.max() <= 55
    np.testing.assert_array_equal(even_subset(5, 10), np.arange(5))


def test_packed_numbers_come_back():
    np.testing.assert_array_equal(unpacked(packed(np.arange(5), "i4")), np.arange(5))


@pytest.mark.parametrize(("length", "expected"), [(9.99, 5.0), (10.0, 10.0), (0.03, 0.02)])
def test_round_lengths(length, expected):
    assert round_length(length) == pytest.approx(expected)


def test_labels_are_few_and_round():
    assert labelled_frames(np.arange(1, 4)).tolist() == [0, 1, 2]
    numbers = np.delete(np.arange(1, 303), [5, 6])
    labelled = numbers[labelled_frames(numbers)]
    assert labelled.tolist() == [1, 50, 100, 150, 200, 250, 300]
