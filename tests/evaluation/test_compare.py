"""Figures of the comparison: zero for the truth, as expected for errors of known size."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from semsfm_colmap.errors import InputError
from semsfm_colmap.evaluation import Truth, evaluate
from semsfm_colmap.geometry.alignment import Similarity
from semsfm_colmap.geometry.mesh_normals import vertex_normals
from semsfm_colmap.geometry.rotations import rotation_from_vector
from semsfm_colmap.types import DepthSign, Float, Reconstruction, TriangleMesh
from tests.evaluation.series import (
    SCALE,
    UNIT_UM,
    WORLD,
    bumpy_ball,
    make_truth,
    mirrored,
    reconstruction_of,
)

MESH = bumpy_ball()
CHI3_MEDIAN = 1.5382
"""Median length of a vector of three independent standard normal numbers."""
NORMAL_MEDIAN = 0.6745
"""Median absolute value of a standard normal number."""


@pytest.fixture(scope="module")
def truth() -> Truth:
    return make_truth(mesh=MESH)


def on_surface(num: int = 400) -> Float:
    return MESH.vertices[:: len(MESH.vertices) // num]


def outward(num: int = 400) -> Float:
    return vertex_normals(MESH.vertices, MESH.faces)[:: len(MESH.vertices) // num]


def in_world(mesh: TriangleMesh) -> TriangleMesh:
    return replace(mesh, vertices=WORLD.apply(mesh.vertices))


ERRORS = (
    "rotation_error_median_deg",
    "rotation_error_max_deg",
    "rotation_error_rms_deg",
    "first_to_last_rotation_error_deg",
    "translation_error_rms_px",
    "scale_error_percent",
    "relative_magnification_error_rms_percent",
    "aspect_error_percent",
    "skew_error",
    "residual_rms_px",
    "residual_rms_x_px",
    "residual_rms_y_px",
    "structure_signed_median_px",
    "structure_abs_median_px",
    "structure_abs_median_unbiased_px",
    "structure_abs_p95_px",
)


def test_the_truth_against_itself_has_no_errors(truth: Truth) -> None:
    found = evaluate(reconstruction_of(truth, on_surface()), truth, in_world(MESH))
    for key in ERRORS:
        # Distances are computed in single precision: 1e-4 px.
        assert found[key] == pytest.approx(0.0, abs=2e-4 if "structure" in key else 1e-6), key
    assert found["hand"] == "right"
    assert found["num_images_registered"] == found["num_images_truth"] == 12
    assert found["rotation_sum_ratio"] == pytest.approx(1.0, abs=1e-9)
    assert found["mesh_to_truth_abs_p95_px"] < 2e-4
    assert found["truth_to_mesh_within_2px_percent"] == 100.0
    assert found["truth_to_mesh_median_px"] < 2e-4
    assert found["pixel_size_true_um"] == pytest.approx(UNIT_UM / SCALE, rel=1e-3)
    assert found["mean_track_length"] == 12


def test_the_mirrored_truth_is_depth_reversed_and_otherwise_perfect(truth: Truth) -> None:
    found = evaluate(mirrored(reconstruction_of(truth, on_surface())), truth)
    assert found["hand"] == "depth-reversed"
    for key in ERRORS:
        assert found[key] == pytest.approx(0.0, abs=2e-4 if "structure" in key else 1e-6), key
    assert found["rotation_error_median_depth_reversed_deg"] < 1e-6
    assert found["rotation_error_median_as_given_deg"] > 10.0
    assert found["structure_abs_median_depth_reversed_px"] < 2e-4
    assert found["structure_abs_median_as_given_px"] > 2.0


def test_both_hands_are_given_for_the_right_one_too(truth: Truth) -> None:
    found = evaluate(reconstruction_of(truth, on_surface()), truth)
    assert found["rotation_error_median_as_given_deg"] < 1e-6
    assert found["rotation_error_median_depth_reversed_deg"] > 10.0
    assert found["structure_abs_median_as_given_px"] < 2e-4
    assert found["structure_abs_median_depth_reversed_px"] > 2.0


@pytest.mark.parametrize(
    ("status", "reverse", "expected"),
    [
        ("resolved", False, True),
        ("resolved", True, False),
        ("ambiguous", False, None),
        ("ambiguous", True, None),
    ],
)
def test_a_stated_hand_is_judged_and_an_open_one_is_not(
    truth: Truth, status: Any, reverse: bool, expected: bool | None
) -> None:
    r = reconstruction_of(truth, on_surface())
    r = replace(r, depth_sign=DepthSign(status=status, confidence=0.9))
    found = evaluate(mirrored(r) if reverse else r, truth)
    assert found["depth_sign_correct"] is expected
    assert found["depth_sign_status"] == status


def test_rotation_noise_of_known_size_gives_errors_of_the_expected_size() -> None:
    many = make_truth(num=400, range_deg=180.0)
    sigma = np.radians(0.2)
    found = evaluate(reconstruction_of(many, on_surface(3), rotation_noise_rad=sigma), many)
    assert 0.93 * 0.2 * CHI3_MEDIAN < found["rotation_error_median_deg"] < 1.07 * 0.2 * CHI3_MEDIAN
    assert 0.95 * 0.2 * np.sqrt(3) < found["rotation_error_rms_deg"] < 1.05 * 0.2 * np.sqrt(3)
    assert set(found["rotation_error_by_image_deg"]) == set(many.names)
    errors = list(found["rotation_error_by_image_deg"].values())
    assert max(errors) == found["rotation_error_max_deg"]


def test_pixel_noise_of_known_size_is_the_residual(truth: Truth) -> None:
    found = evaluate(reconstruction_of(truth, on_surface(), pixel_noise_px=0.3), truth)
    for key in ("residual_rms_px", "residual_rms_x_px", "residual_rms_y_px"):
        assert 0.285 < found[key] < 0.315, key


def test_rejected_observations_do_not_count(truth: Truth) -> None:
    r = reconstruction_of(truth, on_surface())
    xy = r.observations.xy.copy()
    xy[::7] += 50.0
    inlier = np.ones(len(xy), dtype=bool)
    inlier[::7] = False
    r = replace(r, observations=replace(r.observations, xy=xy), inlier=inlier)
    found = evaluate(r, truth)
    assert found["residual_rms_px"] < 1e-6
    assert found["num_observations"] == inlier.sum()


def test_points_seen_once_do_not_count(truth: Truth) -> None:
    r = reconstruction_of(truth, on_surface())
    inlier = (r.observations.track_idx != 5) | (r.observations.image_idx == 0)
    found = evaluate(replace(r, inlier=inlier), truth)
    assert found["num_points"] == len(r.points) - 1


def test_points_off_the_surface_by_a_known_distance_are_found_so(truth: Truth) -> None:
    rng = np.random.default_rng(2)
    points = on_surface(3000) + (1.5 + 0.8 * rng.normal(size=(len(on_surface(3000)), 1))) * (
        outward(3000) / SCALE
    )
    r = replace(reconstruction_of(truth, points[:1]), points=WORLD.apply(points))
    r = replace(r, observations=reconstruction_of(truth, points).observations)
    r = replace(r, inlier=np.ones(len(r.observations), dtype=bool))
    found = evaluate(r, truth)
    assert found["structure_signed_median_px"] == pytest.approx(1.5, abs=0.06)
    expected = 0.8 * NORMAL_MEDIAN
    assert 0.93 * expected < found["structure_abs_median_unbiased_px"] < 1.07 * expected
    assert found["structure_abs_p95_px"] == pytest.approx(1.5 + 1.645 * 0.8, rel=0.05)
    in_um = found["structure_abs_median_px"] * truth.pixel_size_um
    assert found["structure_abs_median_um"] == pytest.approx(in_um)


def test_a_world_two_percent_too_large_is_two_percent_too_large(truth: Truth) -> None:
    large = Similarity(rotation=WORLD.rotation, scale=1.02 * WORLD.scale, shift=WORLD.shift)
    found = evaluate(reconstruction_of(truth, on_surface(), world=large), truth)
    assert found["scale_error_percent"] == pytest.approx(2.0, abs=1e-6)
    # The size of the world is compared, then aligned away.
    assert found["structure_abs_median_px"] < 2e-4


def test_a_world_in_px_has_no_size_to_be_wrong(truth: Truth) -> None:
    r = replace(reconstruction_of(truth, on_surface()), world_unit="px", pixel_size_um=None)
    assert evaluate(r, truth)["scale_error_percent"] is None


def test_magnifications_are_compared_with_each_other(truth: Truth) -> None:
    r = reconstruction_of(truth, on_surface())
    factor = 1.0 + 0.01 * np.resize([1.0, -1.0], 12)
    cameras = replace(r.cameras, scale_px_per_unit=r.cameras.scale_px_per_unit * factor)
    found = evaluate(replace(r, cameras=cameras), truth)
    assert found["relative_magnification_error_rms_percent"] == pytest.approx(1.0, rel=1e-2)


def test_a_turn_two_percent_too_long_shows_in_its_sum_and_between_first_and_last() -> None:
    straight = make_truth(num=31, range_deg=60.0)
    angle = np.radians(straight.true_deg)[:, None] * [0.0, 1.0, 0.0]
    exact = replace(straight.cameras, cam_from_world=rotation_from_vector(angle))
    longer = replace(straight.cameras, cam_from_world=rotation_from_vector(1.02 * angle))
    known = replace(straight, cameras=exact)
    r = replace(reconstruction_of(known, on_surface(3)), cameras=longer)
    found = evaluate(r, known)
    assert found["rotation_sum_ratio"] == pytest.approx(1.02, abs=1e-9)
    assert found["rotation_sum_true_deg"] == pytest.approx(60.0)
    assert found["first_to_last_rotation_error_deg"] == pytest.approx(1.2, abs=1e-6)
    # Aligned in the middle: errors from -0.6 to 0.6 degrees.
    assert found["rotation_error_max_deg"] == pytest.approx(0.6, rel=1e-3)


def part_of(r: Reconstruction, image_idx: list[int]) -> Reconstruction:
    new = {old: k for k, old in enumerate(image_idx)}
    obs = r.observations
    keep = np.isin(obs.image_idx, image_idx)
    renumbered = np.array([new[i] for i in obs.image_idx[keep]])
    chosen = replace(obs.select(keep), image_idx=renumbered, num_images=len(image_idx))
    return replace(
        r,
        image_names=tuple(r.image_names[i] for i in image_idx),
        cameras=r.cameras.select(np.array(image_idx)),
        image_size_px=r.image_size_px[image_idx],
        observations=chosen,
        inlier=r.inlier[keep],
    )


def test_missing_images_in_any_order_and_with_other_endings_are_matched(truth: Truth) -> None:
    r = part_of(reconstruction_of(truth, on_surface()), [7, 2, 3, 11])
    names = tuple(name.replace(".png", ".tif") for name in r.image_names)
    found = evaluate(replace(r, image_names=names), truth)
    assert found["num_images_registered"] == 4
    assert found["num_images_truth"] == 12
    assert found["rotation_error_max_deg"] < 1e-6
    assert list(found["rotation_error_by_image_deg"]) == [truth.names[i] for i in (2, 3, 7, 11)]
    assert found["structure_abs_median_px"] < 2e-4


def test_images_of_another_series_are_refused(truth: Truth) -> None:
    r = reconstruction_of(truth, on_surface())
    other = tuple(name.replace("ball", "cube") for name in r.image_names)
    with pytest.raises(InputError, match=r"cube_000\.png.*ball_000\.png"):
        evaluate(replace(r, image_names=other), truth)


def test_a_crop_of_the_images_is_undone(truth: Truth) -> None:
    r = reconstruction_of(truth, on_surface())
    cropped = replace(r.cameras, translation_px=r.cameras.translation_px - [30.0, 12.0])
    r = replace(r, cameras=cropped)
    found = evaluate(r, truth, crop_offset_px=(30.0, 12.0))
    assert found["structure_abs_median_px"] < 2e-4
    assert found["translation_error_rms_px"] < 1e-6
    assert evaluate(r, truth)["structure_abs_median_px"] > 1.0


def test_one_image_without_a_surface_does_not_tell_the_hand() -> None:
    bare = make_truth()
    found = evaluate(part_of(reconstruction_of(bare, on_surface()), [4]), bare)
    assert found["hand"] == "undetermined"
    assert found["depth_sign_correct"] is None
    assert found["rotation_sum_ratio"] is None
    assert "structure_abs_median_px" not in found


@pytest.mark.parametrize("change", [lambda r: r, mirrored], ids=["right", "depth-reversed"])
def test_the_figures_are_json(truth: Truth, change: Callable[..., Reconstruction]) -> None:
    r = change(reconstruction_of(truth, on_surface(), pixel_noise_px=0.2))
    found = evaluate(r, truth, in_world(MESH))
    assert json.loads(json.dumps(found, allow_nan=False)) == found


def test_a_reconstruction_without_points_still_has_its_cameras_judged(truth: Truth) -> None:
    r = reconstruction_of(truth, on_surface())
    none = r.observations.select(np.zeros(len(r.observations), dtype=bool))
    r = replace(r, points=np.zeros((0, 3)), observations=none, inlier=np.zeros(0, dtype=bool))
    found = evaluate(r, truth)
    assert found["rotation_error_max_deg"] < 1e-6
    assert found["structure_abs_median_px"] is None
    assert found["residual_rms_px"] is None
    json.dumps(found, allow_nan=False)


def test_a_mesh_in_front_of_the_surface_is_so_by_its_distance(truth: Truth) -> None:
    normal = vertex_normals(MESH.vertices, MESH.faces)
    grown = replace(MESH, vertices=MESH.vertices + 5.0 / SCALE * normal)
    found = evaluate(reconstruction_of(truth, on_surface()), truth, in_world(grown))
    assert found["mesh_to_truth_signed_median_px"] == pytest.approx(5.0, rel=0.02)
    assert found["mesh_to_truth_abs_median_unbiased_px"] < 0.1
    assert found["truth_to_mesh_median_px"] == pytest.approx(5.0, rel=0.02)
    assert found["truth_to_mesh_within_2px_percent"] == 0.0


def test_a_side_that_no_camera_sees_need_not_be_in_the_mesh(truth: Truth) -> None:
    a, b, c = (MESH.vertices[MESH.faces[:, k]] for k in range(3))
    turned_away = np.cross(b - a, c - a) @ truth.cameras.viewing_direction.T > 0
    front = replace(MESH, faces=MESH.faces[~turned_away.all(axis=1)])
    centres = (a + b + c) / 3.0
    upper = replace(MESH, faces=MESH.faces[centres[:, 1] < 0.0])
    r = reconstruction_of(truth, on_surface())
    assert len(front.faces) < 0.85 * len(MESH.faces)
    assert evaluate(r, truth, in_world(front))["truth_to_mesh_within_2px_percent"] == 100.0
    half = evaluate(r, truth, in_world(upper))["truth_to_mesh_within_2px_percent"]
    assert 45.0 < half < 60.0


def test_the_mesh_of_the_wrong_hand_is_judged_in_the_mirror(truth: Truth) -> None:
    world = in_world(MESH)
    mesh = replace(world, vertices=world.vertices * [1.0, 1.0, -1.0])
    found = evaluate(mirrored(reconstruction_of(truth, on_surface())), truth, mesh)
    assert found["mesh_to_truth_abs_p95_px"] < 2e-4
    assert found["truth_to_mesh_within_2px_percent"] == 100.0


def test_an_empty_mesh_covers_nothing(truth: Truth) -> None:
    empty = TriangleMesh(vertices=np.zeros((0, 3)), faces=np.zeros((0, 3), dtype=np.int64))
    found = evaluate(reconstruction_of(truth, on_surface()), truth, empty)
    assert found["truth_to_mesh_within_2px_percent"] == 0.0
    assert found["mesh_to_truth_abs_median_px"] is None


def test_the_figures_do_not_depend_on_the_world_of_the_reconstruction(truth: Truth) -> None:
    here = Similarity(rotation=np.eye(3), scale=UNIT_UM, shift=np.zeros(3))
    points = on_surface() + 0.01 * np.random.default_rng(3).normal(size=on_surface().shape)
    a, b = (
        evaluate(reconstruction_of(truth, points, world=w, rotation_noise_rad=1e-3), truth)
        for w in (WORLD, here)
    )
    for key in ("rotation_error_median_deg", "structure_abs_median_px", "rotation_sum_ratio"):
        assert a[key] == pytest.approx(b[key], rel=1e-3), key
