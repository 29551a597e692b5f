"""Graduated filtering and bundle adjustment [paper, figure 2 and section "Experimental results"].

Each round triangulates every track robustly with the current cameras, keeps the observations within
the round's threshold and adjusts all cameras to them, with a robust loss; the thresholds fall from
8 px to 1 px. The last round keeps what lies within a few standard deviations and minimises squares:
with nothing wrong left to guard against, a robust loss only wastes information, and COLMAP
minimises squares as well, so that both have the same optimum.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from semsfm_colmap.geometry.eliminated import SolverOptions
from semsfm_colmap.geometry.points import residuals, solve_points, track_pointer
from semsfm_colmap.geometry.subset import keep_tracks, take_exactly, take_subset, thin_evenly
from semsfm_colmap.records import FilteringRound
from semsfm_colmap.refinement.adjustment import (
    Adjustment,
    BundleSettings,
    early_solver,
    last_solver,
)
from semsfm_colmap.refinement.bundle import bundle_adjust
from semsfm_colmap.refinement.known_angles import AnglePrior
from semsfm_colmap.refinement.noise import noise_sigma
from semsfm_colmap.refinement.options import RefinementOptions
from semsfm_colmap.refinement.resection import register_more
from semsfm_colmap.refinement.selection import registered_images, select_inliers
from semsfm_colmap.types import Bool, Float, Int, Observations, OrthographicCameras, Solution

EARLY_OBSERVATIONS = 400
"""Observations an image that the rounds before the last one are content with: a camera's six
parameters are then known to a twentieth of the noise, and the last round uses all."""
MIN_IMAGES = 3
"""Fewer do not give depth."""
TILT_MARGIN = 2.0
"""Nothing is left when all views lie within twice the smallest angle of triangulation: few points
are seen in both of the outermost ones."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Refined:
    """The refined model of one connected part."""

    images: Int
    """Numbers of the registered images"""
    cameras: OrthographicCameras
    """of `images`, in that order"""
    tracks: Int
    """Numbers of the tracks that have a point"""
    points: Float
    inlier: Bool
    """(O,) among all observations given"""
    sigma_px: float
    rounds: tuple[FilteringRound, ...]
    observations: Observations
    """The inliers, numbered as in `images` and `tracks`"""
    rms_px: float
    """residual per coordinate, root mean square"""
    adjustment: Adjustment[OrthographicCameras]
    """of the images alone, known angles apart: what the error bars are made from"""


def adjust_with_angles(refined: Refined, angles: AnglePrior, options: RefinementOptions) -> Refined:
    """Adjust once more with known angles between the registered images; inliers stay.

    The error bars stay those of the images alone.
    """
    result = bundle_adjust(
        refined.cameras,
        refined.observations,
        BundleSettings.of(options, refined.sigma_px, last_solver(options)),
        angles=angles,
    )
    assert result.value is not None
    return replace(refined, cameras=result.value.cameras, points=result.value.points)


def adjust_again(
    refined: Refined, observations: Observations, options: RefinementOptions
) -> Refined:
    """Adjust to the same inliers at other places or of other weights.

    Parameters
    ----------
    observations : all that the inliers were selected from, in the same order

    """
    kept = take_exactly(observations, refined.images, refined.tracks)
    used = kept.observations.select(refined.inlier[kept.rows])
    result = bundle_adjust(
        refined.cameras, used, BundleSettings.of(options, refined.sigma_px, last_solver(options))
    )
    adjustment = result.value
    assert adjustment is not None
    r = adjustment.residuals
    pointer = track_pointer(used.track_idx, used.num_tracks)
    return replace(
        refined,
        cameras=adjustment.cameras,
        points=adjustment.points,
        sigma_px=noise_sigma(r, used.precision, pointer, len(refined.images)),
        observations=used,
        adjustment=adjustment,
        rms_px=float(np.sqrt(np.mean(r**2))),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Selected:
    """The observations of one round, the images that keep enough of them, and their noise."""

    images: Int
    cameras: OrthographicCameras
    tracks: Int
    inlier: Bool
    """(O,) among all observations given"""
    used: Observations
    """the inliers, numbered as in `images` and `tracks`"""
    pointer: Int
    sigma_px: float


def _solve(cameras: OrthographicCameras, used: Observations, pointer: Int) -> tuple[Float, Float]:
    """The best points for some cameras, and the residuals."""
    P, t = cameras.projection, np.asarray(cameras.translation_px)
    X = np.nan_to_num(solve_points(P, t, used.image_idx, pointer, used.xy, used.precision))
    return X, residuals(P, t, X, used.image_idx, used.track_idx, used.xy)


def _select(
    cameras: OrthographicCameras,
    images: Int,
    observations: Observations,
    threshold_px: float,
    options: RefinementOptions,
    seed: int,
    *,
    min_inlier_share: float,
) -> _Selected | None:
    """Select observations, and drop images that starve until none does; None: nothing is left."""
    while True:
        local = take_subset(observations, images=images, min_length=options.min_track_length)
        if len(local.observations) == 0:
            return None
        inlier = select_inliers(cameras, local.observations, threshold_px, options, seed)
        kept = registered_images(
            inlier, local.observations, options, min_inlier_share=min_inlier_share
        )
        if len(kept) < MIN_IMAGES:
            return None
        if len(kept) == len(images):
            break
        images, cameras = images[kept], cameras.select(kept)
    used, tracks = keep_tracks(local.observations, inlier, min_length=options.min_track_length)
    pointer = track_pointer(used.track_idx, used.num_tracks)
    _, r = _solve(cameras, used, pointer)
    return _Selected(
        images=images,
        cameras=cameras,
        tracks=local.tracks[tracks],
        inlier=local.in_whole(inlier),
        used=used,
        pointer=pointer,
        sigma_px=noise_sigma(r, used.precision, pointer, len(images)),
    )


def _adjust(
    selected: _Selected, options: RefinementOptions, solver: SolverOptions, *, final: bool
) -> Refined:
    """Adjust the cameras to the observations selected.

    All rounds but the final one adjust them to a sample of the tracks; they only have to be good
    enough to select observations with.
    """
    used, pointer = selected.used, selected.pointer
    sample = used
    if not final:
        chosen = thin_evenly(used, EARLY_OBSERVATIONS)
        sample, _ = keep_tracks(used, chosen[used.track_idx])
    result = bundle_adjust(
        selected.cameras, sample, BundleSettings.of(options, selected.sigma_px, solver)
    )
    adjustment = result.value
    assert adjustment is not None
    X, r = adjustment.points, adjustment.residuals
    if len(sample) < len(used):
        X, r = _solve(adjustment.cameras, used, pointer)
    sigma = noise_sigma(r, used.precision, pointer, len(selected.images))
    return Refined(
        images=selected.images,
        cameras=adjustment.cameras,
        tracks=selected.tracks,
        points=X,
        inlier=selected.inlier,
        sigma_px=sigma,
        rounds=(),
        observations=used,
        adjustment=adjustment,
        rms_px=float(np.sqrt(np.mean(r**2))),
    )


def refine(
    cameras: OrthographicCameras,
    images: Int,
    observations: Observations,
    options: RefinementOptions,
    *,
    rng: np.random.Generator,
    seed: int = 0,
    series_idx: Int | None = None,
    progress: Callable[[FilteringRound], None] | None = None,
) -> Solution[Refined]:
    """Filter from coarse to fine and adjust, until the last threshold.

    Parameters
    ----------
    cameras : of `images` (numbers in `observations`), about 1 px per unit
    observations : all of them, sorted by track
    series_idx : of all images in `observations`, which of several series each is from

    Returns
    -------
    Solution of Refined; status "too_few_observations" when the tracks do not support three images

    """
    rounds: list[FilteringRound] = []
    fit: Refined | None = None
    thresholds = list(options.filter_thresholds_px)
    for k, threshold in enumerate([*thresholds, thresholds[-1]]):
        last = k == len(thresholds)
        wanted = threshold
        if fit is not None:
            # a norm of two coordinates: sqrt(2) sigma is one standard deviation
            floor = options.min_threshold_sigmas * np.sqrt(2.0) * fit.sigma_px
            wanted = floor if last else max(threshold, floor)
            images, cameras = register_more(
                fit.images, fit.cameras, fit.tracks, fit.points, observations, wanted, options, rng
            )
        if series_idx is not None:
            cameras = replace(cameras, series_idx=series_idx[images])
        # the estimate of sigma wavers a little; a round is never more lenient than the one before
        allowed = min(wanted, rounds[-1].threshold_px if rounds else np.inf)
        share = options.min_image_inlier_share if last else 0.0
        selected = _select(
            cameras, images, observations, allowed, options, seed, min_inlier_share=share
        )
        if selected is None:
            return _nothing_left(cameras, allowed, options)
        solver = last_solver(options) if last else early_solver(options)
        fit = _adjust(selected, options, solver, final=last)
        images, cameras = fit.images, fit.cameras
        rounds.append(
            FilteringRound(
                threshold_px=allowed,
                num_observations=len(fit.observations),
                num_points=len(fit.tracks),
                num_images=len(images),
                sigma_px=fit.sigma_px,
                rms_px=fit.rms_px,
            )
        )
        if progress is not None:
            progress(rounds[-1])
    assert fit is not None
    return Solution(value=replace(fit, rounds=tuple(rounds)))


def _nothing_left(
    cameras: OrthographicCameras, threshold_px: float, options: RefinementOptions
) -> Solution[Refined]:
    """Why fewer than three images keep enough observations."""
    direction = np.asarray(cameras.viewing_direction)
    span = np.rad2deg(np.arccos(np.clip(np.min(direction @ direction.T), -1.0, 1.0)))
    if span < TILT_MARGIN * options.min_triangulation_angle_deg:
        return Solution(
            value=None,
            status="tilt_too_small",
            message=f"the viewing directions differ by {span:.2f} deg only; points whose "
            f"rays lie within {options.min_triangulation_angle_deg:g} deg have no reliable "
            "depth and are left out (--refinement.min_triangulation_angle_deg); tilt "
            "further",
        )
    return Solution(
        value=None,
        status="too_few_observations",
        message=f"fewer than three images keep {options.min_image_observations} "
        f"observations within {threshold_px:.1f} px: the matches do not fit one rigid motion "
        "under parallel projection",
    )
