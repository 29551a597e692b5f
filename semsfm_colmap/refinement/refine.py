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

from semsfm_colmap.geometry.eliminated import Eliminated, SolverOptions
from semsfm_colmap.geometry.points import residuals, solve_points, track_pointer
from semsfm_colmap.geometry.subset import keep_tracks, thin_evenly
from semsfm_colmap.geometry.triangulation import (
    drop_deviating,
    triangulate_tracks,
    triangulation_angle,
)
from semsfm_colmap.refinement.bundle import BundleModel, bundle_adjust
from semsfm_colmap.refinement.known_angles import AnglePrior
from semsfm_colmap.refinement.noise import noise_sigma
from semsfm_colmap.refinement.options import RefinementOptions
from semsfm_colmap.refinement.resection import register_more
from semsfm_colmap.types import (
    Bool,
    Float,
    Int,
    Observations,
    OrthographicCameras,
    Solution,
)

CHI_SQUARE_TOLERANCE = 0.02
"""Stop after a step that lowers chi square by less. The steps converge by a factor of ten or more
each, so what is left is below 0.002: no parameter is off by more than 5 % of its sigma."""
EARLY_ITERATIONS = 8
"""Steps of the bundle adjustment in all rounds but the last: enough to move before refiltering."""
EARLY_OBSERVATIONS = 400
"""Observations an image that the rounds before the last one are content with: a camera's six
parameters are then known to a twentieth of the noise, and the last round uses all."""
TILT_MARGIN = 2.0
"""Nothing is left when all views lie within twice the smallest angle of triangulation: few points
are seen in both of the outermost ones."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Round:
    """What one round of filtering did."""

    threshold_px: float
    num_observations: int
    num_points: int
    num_images: int
    sigma_px: float
    rms_px: float


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
    rounds: tuple[Round, ...]
    observations: Observations
    """The inliers, numbered as in `images` and `tracks`"""
    state: Eliminated[OrthographicCameras]
    model: BundleModel


def select_inliers(
    cameras: OrthographicCameras,
    observations: Observations,
    threshold_px: float,
    options: RefinementOptions,
    seed: int,
) -> Bool:
    """Observations that support a well-conditioned point within the threshold."""
    obs = observations
    pointer = track_pointer(obs.track_idx, obs.num_tracks)
    _, inlier = triangulate_tracks(
        cameras.projection,
        np.asarray(cameras.translation_px),
        obs.image_idx,
        pointer,
        obs.xy,
        threshold_px=threshold_px,
        trials=options.ransac_trials,
        seed=seed,
    )
    inlier = drop_deviating(
        cameras.projection,
        np.asarray(cameras.translation_px),
        obs.image_idx,
        pointer,
        obs.xy,
        inlier,
        threshold_px=threshold_px,
        min_length=options.min_track_length,
    )
    length = np.bincount(obs.track_idx[inlier], minlength=obs.num_tracks)
    angle = triangulation_angle(cameras.viewing_direction, obs.image_idx, pointer, inlier)
    good = (length >= options.min_track_length) & (
        angle >= np.deg2rad(options.min_triangulation_angle_deg)
    )
    return inlier & good[obs.track_idx]


def registered_images(
    inlier: Bool,
    observations: Observations,
    options: RefinementOptions,
    *,
    min_inlier_share: float = 0.0,
) -> Int:
    """Images with enough inlier observations, in number and among those of tracks with a point."""
    obs = observations
    count = np.bincount(obs.image_idx[inlier], minlength=obs.num_images)
    has_point = np.bincount(obs.track_idx[inlier], minlength=obs.num_tracks) > 0
    total = np.bincount(obs.image_idx[has_point[obs.track_idx]], minlength=obs.num_images)
    return np.flatnonzero(
        (count >= options.min_image_observations) & (count >= min_inlier_share * total)
    )


def adjust_with_angles(refined: Refined, angles: AnglePrior, options: RefinementOptions) -> Refined:
    """Adjust once more with known angles between the registered images; inliers stay."""
    result = bundle_adjust(
        refined.cameras,
        refined.observations,
        camera_model=options.camera_model,
        scale_sigma=options.scale_sigma,
        affine_sigma=options.affine_sigma,
        sigma_px=refined.sigma_px,
        angles=angles,
        solver=SolverOptions(
            max_iterations=options.max_iterations,
            absolute_tolerance=CHI_SQUARE_TOLERANCE,
            loss=options.last_loss,
            loss_width=options.loss_width,
        ),
    )
    assert result.value is not None
    cameras, points = result.value
    return replace(
        refined,
        cameras=cameras,
        points=points,
        state=result.diagnostics["state"],
        model=result.diagnostics["model"],
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Fit:
    images: Int
    tracks: Int
    cameras: OrthographicCameras
    points: Float
    observations: Observations
    inlier: Bool
    sigma_px: float
    residuals: Float
    state: Eliminated[OrthographicCameras]
    model: BundleModel


def _adjust(
    cameras: OrthographicCameras,
    images: Int,
    observations: Observations,
    threshold_px: float,
    options: RefinementOptions,
    solver: SolverOptions,
    seed: int,
    *,
    final: bool,
) -> _Fit | None:
    """One round: select, drop images that starve, adjust. None when nothing is left.

    All rounds but the final one adjust the cameras to a sample of the tracks; they only have to be
    good enough to select observations with.
    """
    num_images = observations.num_images
    while True:
        number = np.full(num_images, -1, dtype=np.int64)
        number[images] = np.arange(len(images))
        usable = number[observations.image_idx] >= 0
        local, track_number = keep_tracks(
            observations, usable, min_length=options.min_track_length, image_number=number
        )
        if len(local) == 0:
            return None
        inlier = select_inliers(cameras, local, threshold_px, options, seed)
        kept = registered_images(
            inlier,
            local,
            options,
            min_inlier_share=options.min_image_inlier_share if final else 0.0,
        )
        if len(kept) < 3:
            return None
        if len(kept) == len(images):
            break
        images, cameras = images[kept], cameras.select(kept)
    used, tracks = keep_tracks(local, inlier, min_length=options.min_track_length)
    pointer = track_pointer(used.track_idx, used.num_tracks)
    P, t = cameras.projection, np.asarray(cameras.translation_px)
    X = np.nan_to_num(solve_points(P, t, used.image_idx, pointer, used.xy, used.precision))
    r = residuals(P, t, X, used.image_idx, used.track_idx, used.xy)
    sigma = noise_sigma(r, used.precision, pointer, len(images))
    sample = used
    if not final:
        chosen = thin_evenly(used, EARLY_OBSERVATIONS)
        sample, _ = keep_tracks(used, chosen[used.track_idx])
    result = bundle_adjust(
        cameras,
        sample,
        camera_model=options.camera_model,
        scale_sigma=options.scale_sigma,
        affine_sigma=options.affine_sigma,
        sigma_px=sigma,
        solver=solver,
    )
    assert result.value is not None
    state = result.diagnostics["state"]
    cameras, X = result.value
    r = state.residuals
    if len(sample) < len(used):
        P, t = cameras.projection, np.asarray(cameras.translation_px)
        X = np.nan_to_num(solve_points(P, t, used.image_idx, pointer, used.xy, used.precision))
        r = residuals(P, t, X, used.image_idx, used.track_idx, used.xy)
    # back to the numbering of the caller
    all_tracks = track_number[tracks]
    full = np.zeros(len(observations), dtype=bool)
    known = np.zeros(observations.num_tracks, dtype=bool)
    known[track_number] = True
    positions = np.flatnonzero(usable & known[observations.track_idx])
    full[positions[inlier]] = True
    return _Fit(
        images=images,
        tracks=all_tracks,
        cameras=cameras,
        points=X,
        observations=used,
        inlier=full,
        sigma_px=noise_sigma(r, used.precision, pointer, len(images)),
        residuals=r,
        state=state,
        model=result.diagnostics["model"],
    )


def refine(
    cameras: OrthographicCameras,
    images: Int,
    observations: Observations,
    options: RefinementOptions,
    *,
    rng: np.random.Generator,
    seed: int = 0,
    progress: Callable[[Round], None] | None = None,
) -> Solution[Refined]:
    """Filter from coarse to fine and adjust, until the last threshold.

    Parameters
    ----------
    cameras : of `images` (numbers in `observations`), about 1 px per unit
    observations : all of them, sorted by track

    Returns
    -------
    Solution of Refined; status "too_few_observations" when the tracks do not support three images

    """
    rounds: list[Round] = []
    fit: _Fit | None = None
    thresholds = list(options.filter_thresholds_px)
    for k, threshold in enumerate([*thresholds, thresholds[-1]]):
        last = k == len(thresholds)
        solver = SolverOptions(
            max_iterations=options.max_iterations if last else EARLY_ITERATIONS,
            cost_tolerance=1e-10 if last else 1e-4,
            absolute_tolerance=CHI_SQUARE_TOLERANCE,
            loss=options.last_loss if last else options.loss,
            loss_width=options.loss_width,
        )
        wanted = threshold
        if fit is not None:
            # a norm of two coordinates: sqrt(2) sigma is one standard deviation
            floor = options.min_threshold_sigmas * np.sqrt(2.0) * fit.sigma_px
            wanted = floor if last else max(threshold, floor)
            images, cameras = register_more(
                fit.images, fit.cameras, fit.tracks, fit.points, observations, wanted, options, rng
            )
        # the estimate of sigma wavers a little; a round is never more lenient than the one before
        allowed = min(wanted, rounds[-1].threshold_px if rounds else np.inf)
        fit = _adjust(cameras, images, observations, allowed, options, solver, seed, final=last)
        if fit is None:
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
                f"observations within {allowed:.1f} px: the matches do not fit one rigid motion "
                "under parallel projection",
            )
        images, cameras = fit.images, fit.cameras
        rounds.append(
            Round(
                threshold_px=allowed,
                num_observations=len(fit.observations),
                num_points=len(fit.tracks),
                num_images=len(images),
                sigma_px=fit.sigma_px,
                rms_px=float(np.sqrt(np.mean(fit.residuals**2))),
            )
        )
        if progress is not None:
            progress(rounds[-1])
    assert fit is not None
    return Solution(
        value=Refined(
            images=fit.images,
            cameras=fit.cameras,
            tracks=fit.tracks,
            points=fit.points,
            inlier=fit.inlier,
            sigma_px=fit.sigma_px,
            rounds=tuple(rounds),
            observations=fit.observations,
            state=fit.state,
            model=fit.model,
        )
    )
