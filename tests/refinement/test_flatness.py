"""Planes, shallow relief and grains on a plane, at tilts with and without rotation in the image."""

import numpy as np
import pytest

from semsfm_colmap.geometry.points import residuals, solve_points, track_pointer
from semsfm_colmap.geometry.rotations import rotation_from_vector
from semsfm_colmap.geometry.subset import keep_tracks
from semsfm_colmap.refinement.flatness import flatness, held_out_residuals
from semsfm_colmap.refinement.options import RefinementOptions
from semsfm_colmap.refinement.refine import refine
from semsfm_colmap.types import Observations, OrthographicCameras

NOISE_PX = 0.12


def tilted(points, tilts_deg, roll_deg=0.0, seed=0, seen=0.75, start_scale=1.0):
    """Cameras and observations of points, tilted about y and turned in the image."""
    rng = np.random.default_rng(seed)
    M, N = len(tilts_deg), len(points)
    tilt = np.deg2rad(np.asarray(tilts_deg, dtype=float))[:, None] * [0.0, 1.0, 0.0]
    roll = np.deg2rad(roll_deg * np.arange(M))[:, None] * [0.0, 0.0, 1.0]
    R = rotation_from_vector(roll) @ rotation_from_vector(tilt)
    xy = np.einsum("mij,nj->nmi", R[:, :2], points) + 500.0
    xy += NOISE_PX * rng.normal(size=xy.shape)
    obs = Observations(
        image_idx=np.tile(np.arange(M), N),
        track_idx=np.repeat(np.arange(N), M),
        keypoint_idx=np.arange(M * N),
        xy=xy.reshape(-1, 2),
        num_images=M,
        num_tracks=N,
    )
    obs, _ = keep_tracks(obs, rng.random(M * N) < seen, min_length=3)
    # what noise makes of the angles: begin with wrong ones
    R = rotation_from_vector(roll) @ rotation_from_vector(start_scale * tilt)
    cameras = OrthographicCameras(
        cam_from_world=R, scale_px_per_unit=np.ones(M), translation_px=np.full((M, 2), 500.0)
    )
    return cameras, obs


def relief(depth_px, seed=1, share=1.0, num=700):
    rng = np.random.default_rng(seed)
    points = rng.uniform(-300, 300, (num, 3))
    points[:, 2] = depth_px * rng.normal(size=num) * (rng.random(num) < share)
    return points


def judged(points, tilts_deg, **options):
    cameras, obs = tilted(points, tilts_deg, **options)
    rng = np.random.default_rng(0)
    fit = refine(cameras, np.arange(len(cameras)), obs, RefinementOptions(), rng=rng).value
    return flatness(fit.cameras, fit.points, fit.observations)


TILTS = [np.linspace(0, 48, 7), np.linspace(-24, 24, 7), np.linspace(0, 20, 5), [-30, 0, 30, 50]]


@pytest.mark.parametrize("roll_deg", [0.0, 15.0])
@pytest.mark.parametrize("tilts_deg", TILTS)
def test_a_plane_is_flat_whatever_its_tilts_and_turns(tilts_deg, roll_deg):
    found = judged(relief(0.0), tilts_deg, roll_deg=roll_deg, start_scale=0.7)
    assert found.is_flat()
    assert "flat" in found.message


def test_an_inclined_plane_is_flat():
    points = relief(0.0) @ rotation_from_vector(np.array([0.2, 0.4, 0.0])).T
    assert judged(points, np.linspace(0, 40, 6)).is_flat()


@pytest.mark.parametrize("tilts_deg", TILTS)
def test_shallow_relief_of_some_sigmas_is_not_flat(tilts_deg):
    span = np.deg2rad(np.ptp(tilts_deg))
    assert not judged(relief(3.0 * NOISE_PX / np.sin(span / 2) / 2), tilts_deg).is_flat()


def test_few_grains_on_a_plane_are_depth():
    assert not judged(relief(20.0, share=0.1), np.linspace(0, 48, 7)).is_flat()


def test_three_images_can_be_judged():
    assert judged(relief(0.0), [0, 20, 40], seen=1.0).is_flat()
    assert not judged(relief(5.0), [0, 20, 40], seen=1.0).is_flat()


def test_the_foreshortening_gives_the_tilt_of_a_plane_that_faces_the_viewer():
    assert judged(relief(0.0), np.linspace(0, 48, 7)).facing_deg == pytest.approx(48.0, abs=0.3)


def test_held_out_residuals_are_those_of_fits_without_the_observation():
    cameras, obs = tilted(relief(50.0, num=6), np.linspace(0, 30, 5), seen=1.0)
    A, t = np.ascontiguousarray(cameras.projection), np.asarray(cameras.translation_px)

    def fitted(some):
        pointer = track_pointer(some.track_idx, some.num_tracks)
        return solve_points(A, t, some.image_idx, pointer, some.xy, some.precision)

    r = residuals(A, t, fitted(obs), obs.image_idx, obs.track_idx, obs.xy)
    held = held_out_residuals(A, r, obs)
    for o in range(0, len(obs), 4):
        X = fitted(obs.select(np.arange(len(obs)) != o))[obs.track_idx[o]]
        expected = A[obs.image_idx[o]] @ X + t[obs.image_idx[o]] - obs.xy[o]
        np.testing.assert_allclose(held[o], expected, atol=1e-8)
