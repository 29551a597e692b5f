"""The ladder of camera models: fit, compare, and say where they disagree.

At a small total tilt a change of magnification looks like a change of angle (0.1 % shifts a tilt
of 18 degrees by 3 %), so the magnification that a model allows decides the depth. No model is safe
there. All rungs are fitted to the same inliers and compared by the Bayesian information criterion
and by residuals at observations that the fit has not seen; where their total rotations differ by
more than their error bars, depth is uncertain by that much, and it is said.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
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
MAX_PAIRED = 60
"""Images that are compared with one another for the total rotation; the ends are among them."""
HELD_OUT_EVERY = 10
"""Every tenth observation of long tracks is held out."""
MAX_TRACKS = 1500
"""The comparison uses about so many tracks, spread evenly: it is about cameras, not points."""
MIN_IMAGE_OBSERVATIONS = 150
"""Long series keep so many observations of each image, whatever number of tracks that takes."""
MAX_BIC_SHARE = 1.1
"""Without held-out residuals a rung is ruled out when its criterion is larger by more."""
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
    disagreement: float = 0.0
    """largest relative difference of the total rotation between a rung that is not ruled out and
    the one with the magnifications' prior"""
    drift_px: Float | None = None
    """(M, 2) displacement of the last row against the first one, under the rung with drift"""


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
    further : rungs that were fitted elsewhere to as many of the tracks

    """
    obs = thin_tracks(observations, MAX_TRACKS)
    out = held_out_mask(obs)
    kept, held = obs.select(~out), obs.select(out)

    def rung(name: str, fit: Adjustment[Any]) -> Rung:
        end, model = fit.state, fit.model
        A, t = model.cameras(end.params)
        r = residuals(A, t, end.X, held.image_idx, held.track_idx, held.xy)
        return Rung(
            name=name,
            range_deg=float(np.rad2deg(total_rotation(np.asarray(fit.cameras.cam_from_world)))),
            bic=float(end.cost + model.num_params * np.log(2 * len(kept))),
            held_out_px=float(np.sqrt(np.median(r**2))) if len(held) else float("nan"),
            num_parameters=model.num_params,
        )

    rungs = []
    for name, model, sigma in LADDER:
        start = cameras
        if model == "orthographic":
            start = replace(cameras, scale_px_per_unit=np.ones(len(cameras)), aspect=1.0, skew=0.0)
        scale_sigma = settings.scale_sigma if sigma is None else sigma
        fit = bundle_adjust(
            start, kept, replace(settings, camera_model=model, scale_sigma=scale_sigma)
        )
        assert fit.value is not None
        rungs.append(rung(name, fit.value))
    drift = None
    if height_px is not None:
        drifting = adjust_with_drift(cameras, kept, height_px, settings)
        assert drifting.value is not None
        drift = drifting.value.state.params[1]
        rungs.append(rung(DRIFT_RUNG, drifting.value))
    return replace(judge((*rungs, *further), np.rad2deg(range_sigma_rad)), drift_px=drift)


def judge(rungs: tuple[Rung, ...], range_sigma_deg: float) -> ModelComparison:
    """The best rung, the spread of the total rotation, and a sentence."""
    best = min(rungs, key=lambda rung: rung.bic)
    # a rung is ruled out when its held-out residuals are clearly worse than the best one's
    least = min(rung.held_out_px for rung in rungs)
    alive = [r for r in rungs if not r.held_out_px > 1.05 * least]
    ranges = np.array([rung.range_deg for rung in alive])
    written = next((r.range_deg for r in rungs if r.name == LADDER[1][0]), rungs[0].range_deg)
    # without residuals that were held out, the criterion itself rules out
    fits = [
        r for r in alive if np.isfinite(r.held_out_px) or r.bic <= MAX_BIC_SHARE * abs(best.bic)
    ]
    disagreement = max(
        (abs(r.range_deg - written) / max(written, 1e-12) for r in fits), default=0.0
    )
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
        disagreement=disagreement,
    )
