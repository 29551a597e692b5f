"""The ladder of camera models: fit, compare, and say where they disagree.

At a small total tilt a change of magnification looks like a change of angle (0.1 % shifts a tilt
of 18 degrees by 3 %), so the magnification that a model allows decides the depth. No model is safe
there. All rungs are fitted to the same inliers and compared by the Bayesian information criterion
and by residuals at observations that the fit has not seen; where their total rotations differ by
more than their error bars, depth is uncertain by that much, and it is said.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from semsfm_colmap.geometry.points import residuals
from semsfm_colmap.geometry.rotations import rotation_angle
from semsfm_colmap.geometry.subset import keep_tracks, thin_evenly
from semsfm_colmap.records import Rung
from semsfm_colmap.refinement.adjustment import Adjustment, BundleSettings
from semsfm_colmap.refinement.bundle import bundle_adjust
from semsfm_colmap.refinement.options import CameraModelName
from semsfm_colmap.refinement.scan_drift import adjust_with_drift
from semsfm_colmap.types import Bool, Float, Observations, OrthographicCameras

LADDER: tuple[tuple[str, CameraModelName, float | None], ...] = (
    ("orthographic", "orthographic", 0.0),
    ("scaled, prior", "scaled_orthographic", None),
    ("scaled, free", "scaled_orthographic", 0.1),
    ("affine", "affine", None),
)
"""Name, camera model, standard deviation of the magnifications (None: the prior's)."""
DRIFT_RUNG = "scan drift"
"""Name of the rung with a linear displacement along the rows of each frame."""
STRETCH_RUNG = "stretched frames"
"""Name of the rung with an aspect and a skew of each frame's own; see STRETCH."""
STRETCH = 0.02
"""Standard deviation of these: what a raster that changes between frames, or a viewer that saved
them, may do. It leaves little of the total rotation, so that the rung counts only where it wins."""
SIZES_RUNG = "equal sizes"
"""Name of the rung that takes frames of other sizes for scaled ones."""
CLEAR_WIN = 0.8
"""Held-out residuals with which the rung of stretched frames counts, as a share of the best of the
others."""
MAX_PAIRED = 60
"""Images that are compared with one another for the total rotation; the ends are among them."""
HELD_OUT_EVERY = 10
"""Every tenth observation of long tracks is held out."""
MAX_TRACKS = 1500
"""The comparison uses about so many tracks, spread evenly: it is about cameras, not points."""
MIN_IMAGE_OBSERVATIONS = 150
"""Long series keep so many observations of each image, whatever number of tracks that takes."""
ALIVE_RATIO = 1.05
"""Held-out residuals up to so many times the best rung's do not rule a rung out."""
ALIVE_RATIO_SIZES = 1.2
"""That frames differ in size is a fact: the rung that takes it for scaling has more credit."""
ALIVE_BIC = 10.0
"""Where nothing can be held out, so much more than the smallest BIC does not, or so much of it as
these residuals would make: noise that is not quite independent lets it vary by percents."""
DISAGREEMENT_SIGMAS = 3.0
"""Models disagree when they differ by more than this many joint standard deviations."""
MIN_DISAGREEMENT = 0.01
"""Differences of the total rotation below one percent are not worth a sentence."""


@dataclass(frozen=True, kw_only=True)
class ModelComparison:
    """The ladder, and whether it matters which rung one stands on."""

    rungs: tuple[Rung, ...]
    best: str
    """name of the rung with the smallest BIC"""
    depth_uncertainty: float
    """relative spread of the total rotation over the rungs that the data do not rule out"""
    disagree: bool
    """True when that spread is more than their error bars"""
    message: str
    drift_px: Float | None = None
    """(M, 2) displacement of the last row against the first one, under the rung with drift"""
    alive: tuple[str, ...] = ()
    """names of the rungs that the data do not rule out"""
    cameras: Mapping[str, OrthographicCameras] = field(default_factory=dict)
    """for each rung the cameras it gives"""


def widest_pair(R: Float) -> tuple[int, int]:
    """The two images furthest apart in rotation: (M, 3, 3) -> (a, b); of many, some are tried."""
    thin = np.unique(np.linspace(0, len(R) - 1, min(len(R), MAX_PAIRED)).round().astype(np.int64))
    relative = np.einsum("aij,bkj->abik", R[thin], R[thin])
    a, b = np.unravel_index(np.argmax(rotation_angle(relative)), (len(thin), len(thin)))
    return int(thin[min(a, b)]), int(thin[max(a, b)])


def total_rotation(R: Float) -> float:
    """The largest rotation angle between two images, in rad, about any axis: (M, 3, 3) -> rad."""
    a, b = widest_pair(R)
    return float(rotation_angle(R[b] @ R[a].T))


def thin_tracks(observations: Observations, max_tracks: int) -> Observations:
    """Some of the tracks, spread evenly: about `max_tracks`, more if images would lack them."""
    if observations.num_tracks <= max_tracks:
        return observations
    mean_length = len(observations) / observations.num_tracks
    per_image = int(np.ceil(max_tracks * mean_length / observations.num_images))
    chosen = thin_evenly(observations, max(per_image, MIN_IMAGE_OBSERVATIONS))
    return keep_tracks(observations, chosen[observations.track_idx])[0]


def held_out_mask(observations: Observations) -> Bool:
    """Observations to hold out: every tenth, in tracks that keep three others."""
    length = np.bincount(observations.track_idx, minlength=observations.num_tracks)
    long = length[observations.track_idx] >= 4
    mask = np.zeros(len(observations), dtype=bool)
    rows = np.flatnonzero(long)[::HELD_OUT_EVERY]
    # at most one a track
    _, first = np.unique(observations.track_idx[rows], return_index=True)
    mask[rows[first]] = True
    return mask


def compare_models(
    cameras: OrthographicCameras,
    observations: Observations,
    settings: BundleSettings,
    *,
    range_sigma_rad: float = 0.0,
    height_px: Float | None = None,
    size_px: Float | None = None,
    further: tuple[Rung, ...] = (),
) -> ModelComparison:
    """Fit every rung of the ladder and compare.

    Parameters
    ----------
    cameras : a converged fit, about 1 px per unit
    observations : inliers, sorted by track
    settings : priors, noise and search; each rung has a camera model of its own
    range_sigma_rad : error bar of the total rotation under the chosen model
    height_px : (M,) heights of the images; without them drift within the frames is not tried
    size_px : (M, 2) width and height of the images; without them their stretches are not tried
    further : rungs that were fitted elsewhere to as many of the tracks

    """
    obs = thin_tracks(observations, MAX_TRACKS)
    out = held_out_mask(obs)
    kept, held = obs.select(~out), obs.select(out)

    rungs: list[Rung] = []
    found: dict[str, OrthographicCameras] = {}

    def add(
        name: str, fit: Adjustment[Any], share: float = np.inf, seen: Observations = held
    ) -> None:
        end, model = fit.state, fit.model
        A, t = model.cameras(end.params)
        r = residuals(A, t, end.X, seen.image_idx, seen.track_idx, seen.xy)
        held_out_px = float(np.sqrt(np.median(r**2))) if len(held) else float("nan")
        if held_out_px > share * min((rung.held_out_px for rung in rungs), default=np.inf):
            return
        found[name] = fit.cameras
        rungs.append(
            Rung(
                name=name,
                range_deg=float(np.rad2deg(total_rotation(np.asarray(fit.cameras.cam_from_world)))),
                bic=float(end.cost + model.num_params * np.log(2 * len(kept))),
                held_out_px=held_out_px,
                num_parameters=model.num_params,
            )
        )

    for name, model, sigma in LADDER:
        start = cameras
        if model == "orthographic":
            start = replace(cameras, scale_px_per_unit=cameras.common_scale, aspect=1.0, skew=0.0)
        scale_sigma = settings.scale_sigma if sigma is None else sigma
        fit = bundle_adjust(
            start, kept, replace(settings, camera_model=model, scale_sigma=scale_sigma)
        )
        assert fit.value is not None
        add(name, fit.value)
    drift = None
    if height_px is not None:
        drifting = adjust_with_drift(cameras, kept, height_px, settings)
        assert drifting.value is not None
        drift = drifting.value.state.params[1]
        add(DRIFT_RUNG, drifting.value)
    if size_px is not None and len(held) > 0:
        if np.any(np.ptp(size_px, axis=0) > 0):
            alike, seen = equal_sizes(kept, size_px), equal_sizes(held, size_px)
            start = equal_sizes_of(cameras, size_px)
            scaled = bundle_adjust(start, alike, settings)
            assert scaled.value is not None
            add(SIZES_RUNG, scaled.value, seen=seen)
        wide = replace(settings, drift_sigma_px=STRETCH * float(np.mean(size_px[:, 1])))
        stretched = adjust_with_drift(cameras, kept, size_px[:, 1].astype(np.float64), wide)
        assert stretched.value is not None
        add(STRETCH_RUNG, stretched.value, CLEAR_WIN)
    verdict = judge((*rungs, *further), np.rad2deg(range_sigma_rad))
    return replace(verdict, drift_px=drift, cameras=found)


def equal_sizes(observations: Observations, size_px: Float) -> Observations:
    """The observations in frames that are all scaled to the largest size."""
    factor = size_px.max(axis=0) / size_px
    return replace(observations, xy=observations.xy * factor[observations.image_idx])


def equal_sizes_of(cameras: OrthographicCameras, size_px: Float) -> OrthographicCameras:
    """Cameras to begin a fit with in such frames."""
    factor = size_px.max(axis=0) / size_px
    return replace(cameras, translation_px=cameras.translation_px * factor)


def is_ruled_out(rung: Rung, rungs: Sequence[Rung]) -> bool:
    """Whether the held-out residuals are clearly worse than the best rung's.

    Where tracks are too short to hold anything out, as of three images, the BIC decides.
    """
    held = [other.held_out_px for other in rungs]
    if np.all(np.isfinite(held)):
        ratio = ALIVE_RATIO_SIZES if rung.name == SIZES_RUNG else ALIVE_RATIO
        return rung.held_out_px > ratio * min(held)
    least = min(other.bic for other in rungs)
    return rung.bic > least + max(ALIVE_BIC, (ALIVE_RATIO**2 - 1.0) * abs(least))


def judge(rungs: tuple[Rung, ...], range_sigma_deg: float) -> ModelComparison:
    """The best rung, the spread of the total rotation, and a sentence."""
    best = min(rungs, key=lambda rung: rung.bic)
    alive = [rung for rung in rungs if not is_ruled_out(rung, rungs)]
    ranges = np.array([rung.range_deg for rung in alive])
    spread = float(np.ptp(ranges) / max(np.mean(ranges), 1e-12))
    limit = max(
        MIN_DISAGREEMENT, DISAGREEMENT_SIGMAS * range_sigma_deg / max(float(np.mean(ranges)), 1e-12)
    )
    listed = ", ".join(f"{r.name} {r.range_deg:.2f}" for r in alive)
    disagree = spread > limit
    if disagree:
        message = (
            f"the camera models that fit disagree on the total rotation ({listed} deg): depth is "
            f"uncertain by {100 * spread:.0f} %; a larger tilt or a known angle would settle it"
        )
    else:
        message = f"the camera models agree on the total rotation to {100 * spread:.1f} %"
    return ModelComparison(
        rungs=rungs,
        best=best.name,
        depth_uncertainty=spread,
        disagree=disagree,
        message=message,
        alive=tuple(rung.name for rung in alive),
    )
