"""A turntable seen by an ordinary camera, from tracks to a model of parallel projection."""

import numpy as np
import pytest

from semsfm_colmap.factorization.options import FactorizationOptions
from semsfm_colmap.mapping.keypoints import append_keypoints
from semsfm_colmap.mapping.parts import map_observations
from semsfm_colmap.refinement.options import RefinementOptions
from tests.alignment import best_hand_errors_deg
from tests.refinement.test_perspective import RADIUS, SIZE, scene

M = 18


def mapped(kappa):
    s = scene(
        kappa, num_images=M, range_deg=340.0, num_tracks=700, track_window=7, outlier_share=0.02,
        centre=(40.0, 0.0, 20.0),
    )  # fmt: skip
    solution = map_observations(
        s.observations,
        tuple(f"{i:02}.png" for i in range(M)),
        np.full((M, 2), int(SIZE)),
        factorization=FactorizationOptions(),
        refinement=RefinementOptions(),
    )
    (part,) = solution.value
    return s, part


@pytest.fixture(scope="module")
def turntable():
    return mapped(0.08 / RADIUS)


def test_the_poses_of_a_turntable_are_right_within_their_error_bars(turntable):
    s, part = turntable
    r = part.reconstruction
    assert r.num_images == M
    error = best_hand_errors_deg(r.cameras.cam_from_world, s.cameras.cam_from_world)
    sigma = np.rad2deg(np.sqrt(np.sum(r.sigma_rotation_rad**2, axis=1)))
    assert np.sqrt(np.mean(error**2)) < 0.1
    assert np.sqrt(np.mean(error**2)) < 1.5 * np.sqrt(np.mean(sigma**2))
    assert np.sqrt(np.mean(r.residuals()[r.inlier] ** 2)) < 0.32


def test_what_was_taken_out_is_said(turntable):
    _, part = turntable
    found = part.figures.reliability.perspective
    assert found.used
    # tracks tell the hand of a body, and in the right one an ordinary lens has a positive distance
    assert found.kappa_per_px == pytest.approx(0.08 / RADIUS, rel=0.02)
    assert any("rays are not parallel" in note for note in part.figures.notes)


def test_the_keypoints_of_the_model_are_where_its_observations_are(turntable):
    s, part = turntable
    obs = s.observations
    raw = {}
    for i in range(M):
        mine = obs.image_idx == i
        raw[f"{i:02}.png"] = np.zeros((int(obs.keypoint_idx.max()) + 1, 2))
        raw[f"{i:02}.png"][obs.keypoint_idx[mine]] = obs.xy[mine]
    (same,), moved = append_keypoints([part], raw)
    r = same.reconstruction
    for i, name in enumerate(r.image_names):
        mine = r.observations.image_idx == i
        assert len(moved[name]) == len(raw[name])
        np.testing.assert_array_equal(
            moved[name][r.observations.keypoint_idx[mine]], r.observations.xy[mine]
        )


def test_parallel_rays_stay_as_they_are():
    s, part = mapped(0.0)
    assert part.figures.reliability.perspective is None
    assert [rung.name for rung in part.figures.reliability.models].count("perspective") == 1
    error = best_hand_errors_deg(
        part.reconstruction.cameras.cam_from_world, s.cameras.cam_from_world
    )
    assert np.sqrt(np.mean(error**2)) < 0.1


def test_pinholes_of_that_focal_length_see_what_was_seen(turntable):
    s, part = turntable
    r, view = part.reconstruction, part.view
    obs = r.observations.select(r.inlier)
    T = view.pinhole_translations(r.cameras)[obs.image_idx]
    R = np.asarray(r.cameras.cam_from_world)[obs.image_idx]
    cam = np.einsum("oij,oj->oi", R, r.points[obs.track_idx]) + T
    assert (cam[:, 2] > 0).all()
    pinhole = cam[:, :2] / cam[:, 2:] / view.kappa + view.principal_px[obs.image_idx]
    seen = np.zeros((len(s.observations), 2))
    seen[s.observations.keypoint_idx] = s.observations.xy
    error = pinhole - seen[obs.keypoint_idx]
    assert np.sqrt(np.mean(error**2)) < 0.32


def test_perspective_that_is_left_in_is_named_and_in_the_error_bar():
    s = scene(0.002 / RADIUS, num_images=9, range_deg=60.0, num_tracks=600, body="field")
    options = RefinementOptions(perspective="off")
    (part,) = map_observations(
        s.observations,
        tuple(f"{i:02}.png" for i in range(9)),
        np.full((9, 2), int(SIZE)),
        factorization=FactorizationOptions(),
        refinement=options,
    ).value
    trust = part.figures.reliability
    assert not trust.perspective.used
    assert abs(trust.perspective.kappa_per_px) == pytest.approx(0.002 / RADIUS, rel=0.1)
    share = trust.total_rotation_sigma_parts_deg["perspective"] / abs(trust.perspective.change_deg)
    assert 0.25 < share < 1.0
    assert part.view is None
