"""Errors of a fit against the truth, their bounds, and their means over many series."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.geometry.series import NOISE_PX
from semsfm_colmap.geometry.eliminated import Eliminated
from semsfm_colmap.geometry.rotations import nearest_rotation, rotation_angle
from semsfm_colmap.geometry.subset import keep_tracks
from semsfm_colmap.refinement.bundle import BundleModel
from semsfm_colmap.refinement.covariance import Covariance, estimate_covariance
from semsfm_colmap.refinement.options import RefinementOptions
from semsfm_colmap.refinement.refine import Refined
from semsfm_colmap.synthetic.tracks import SimulatedTracks
from semsfm_colmap.types import Float, OrthographicCameras


def aligned(
    cameras: OrthographicCameras, points: Float, true: OrthographicCameras
) -> tuple[Float, Float, Float]:
    """Rotations and points in the truth's world, and the matrix T of ``X -> X T - shift``."""
    R_true = np.asarray(true.cam_from_world)
    candidates = []
    for reverse in (False, True):
        R = np.asarray(cameras.cam_from_world)
        D = np.diag([1.0, 1.0, -1.0 if reverse else 1.0])
        R = D @ R @ D
        Q = nearest_rotation(np.einsum("mji,mjk->ik", R, R_true))
        candidates.append((R @ Q, D @ Q))
    R, T = min(candidates, key=lambda c: np.median(rotation_angle(c[0] @ R_true.mT)))
    P = true.projection.reshape(-1, 3)
    gap = (np.asarray(true.translation_px) - np.asarray(cameras.translation_px)).ravel()
    shift = np.linalg.lstsq(P, gap, rcond=None)[0]
    return R, T, np.asarray(points) @ T - shift


def errors(fit: Refined, s: SimulatedTracks, true: Float | None = None) -> tuple[float, float]:
    """RMS rotation error in deg and median point error relative to the object's size.

    Parameters
    ----------
    true : the points that the tracks of the fit show, nan for none; from the scene when not given

    """
    if true is None:
        # tracks cut off from others show nothing that is known
        cut_off = fit.tracks >= len(s.points)
        true = np.where(cut_off[:, None], np.nan, s.points[np.where(cut_off, 0, fit.tracks)])
    R, _, X = aligned(fit.cameras, fit.points, s.cameras.select(fit.images))
    angle = rotation_angle(R @ np.asarray(s.cameras.cam_from_world)[fit.images].mT)
    d = X - true
    size = np.sqrt(np.mean(np.sum((s.points - s.points.mean(axis=0)) ** 2, axis=1)))
    middle = np.sqrt(np.nanmedian(np.sum(d * d, axis=1)))
    return float(np.rad2deg(np.sqrt(np.mean(angle**2)))), float(middle / size)


def cramer_rao(s: SimulatedTracks, known_scale: bool) -> Covariance:
    """Covariance of poses and points at the truth, priors included."""
    model = BundleModel.build(
        len(s.cameras),
        free_scale=not known_scale,
        free_affine=False,
        scale_sigma=RefinementOptions().scale_sigma,
        affine_sigma=1.0,
    )
    state = Eliminated(
        params=s.cameras,
        X=np.asarray(s.points),
        residuals=np.zeros((len(s.observations), 2)),
        weight=np.ones(len(s.observations)),
        cost=0.0,
    )
    bound = estimate_covariance(model, state, s.observations, NOISE_PX)
    assert bound.value is not None, bound.message
    return bound.value


def only_right(s: SimulatedTracks) -> SimulatedTracks:
    """The scene without its wrong observations, as an oracle would see it."""
    return replace(s, observations=s.observations.select(s.correct))


def bounds(s: SimulatedTracks, rng: np.random.Generator) -> tuple[float, float]:
    """What the Cramer-Rao bound says of `errors`: of the right observations of tracks of three.

    The median error of points that differ in their bounds is found by drawing errors from them.
    """
    right = only_right(s).observations
    length = np.bincount(right.track_idx, minlength=right.num_tracks)
    kept, tracks = keep_tracks(right, length[right.track_idx] >= 3)
    bound = cramer_rao(replace(s, observations=kept, points=np.asarray(s.points)[tracks]), False)
    rotation = np.sqrt(np.mean(np.sum(bound.sigma_rotation_rad**2, axis=1)))
    L = np.linalg.cholesky(bound.points[np.isfinite(bound.points[:, 0, 0])])
    drawn = np.einsum("nij,knj->kni", L, rng.normal(size=(20, len(L), 3)))
    return float(rotation), float(np.sqrt(np.median(np.sum(drawn**2, axis=2))))


def rms(figures: list[tuple[float, float]]) -> Float:
    """Root mean squares over the series."""
    return np.sqrt(np.mean(np.square(figures), axis=0))


def ratio(some: list[tuple[float, float]], base: list[tuple[float, float]]) -> list[str]:
    """Ratio of the RMS of the same series, and its standard error by the jackknife."""
    square = np.square([some, base])  # (2, series, 2)
    n = square.shape[1]
    without = (square.sum(axis=1, keepdims=True) - square) / (n - 1)
    left = np.sqrt(without[0] / without[1])
    error = np.sqrt((n - 1) * np.mean((left - left.mean(axis=0)) ** 2, axis=0))
    value = rms(some) / rms(base)
    return [f"{v:.2f} ± {e:.2f}" for v, e in zip(value, error, strict=True)]
