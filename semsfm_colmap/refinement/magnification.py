"""How far the magnification differs between the images: the width of its prior, from the series.

Microscopes left alone keep their magnification to 0.05 to 0.3 %; refocused ones, turntables and
copies of images do not, and a prior that is too narrow bends angles and invents drift. Too wide a
one leaves the angle of a small tilt free. Empirical Bayes: of a few widths w the one of the largest
marginal likelihood, the cameras integrated out by Laplace's approximation,

    -2 log p(data | w) = cost(w) + log det S(w) + 2 M log w + constant,

cost(w) the least chi square with the prior's own in it, S(w) the reduced camera system there, M the
number of images. Where the images do not tell the magnification from the tilt the terms for w
cancel, and the smallest width stays.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from semsfm_colmap.refinement.adjustment import BundleSettings, comparing_solver
from semsfm_colmap.refinement.bundle import bundle_adjust
from semsfm_colmap.refinement.covariance import camera_covariance
from semsfm_colmap.refinement.model_choice import MAX_TRACKS, thin_tracks
from semsfm_colmap.refinement.options import RefinementOptions
from semsfm_colmap.refinement.refine import Refined
from semsfm_colmap.types import Float, Observations, OrthographicCameras

WIDTHS = (0.003, 0.01, 0.03, 0.1)
"""Standard deviations that are tried beside the smallest, which the options give."""
MIN_GAIN = 20.0
MIN_GAIN_SHARE = 0.01
"""A wider prior has to lower -2 log p by so much, and by so much of the chi square: errors that
neighbours share count as often as there are neighbours."""


def evidence(
    cameras: OrthographicCameras, observations: Observations, settings: BundleSettings
) -> tuple[float, float]:
    """-2 log of the marginal likelihood but for a constant, and the least cost."""
    fit = bundle_adjust(cameras, observations, settings).value
    assert fit is not None
    found = camera_covariance(fit.model, fit.state, observations, settings.sigma_px)
    if found is None:
        return np.inf, fit.state.cost
    width = 2.0 * len(cameras) * np.log(settings.scale_sigma)
    return fit.state.cost + found.factor.log_determinant + width, fit.state.cost


def magnification_sigma(refined: Refined, options: RefinementOptions) -> float:
    """The standard deviation of the magnification between the images of a refined model.

    Never below that of the options; theirs where the camera model has one magnification or the user
    has fixed it.
    """
    smallest = options.scale_sigma
    if options.camera_model == "orthographic" or options.magnification == "fixed":
        return smallest
    obs = thin_tracks(refined.observations, MAX_TRACKS)
    settings = BundleSettings.of(options, refined.sigma_px, comparing_solver(options))
    best, (least, cost) = smallest, evidence(refined.cameras, obs, settings)
    needed = max(MIN_GAIN, MIN_GAIN_SHARE * cost)
    for width in WIDTHS:
        if width <= smallest:
            continue
        value, _ = evidence(refined.cameras, obs, replace(settings, scale_sigma=width))
        if value < least - needed:
            best, least, needed = width, value, MIN_GAIN
    return best


def magnification_notes(scales: Float, sizes_px: Float, *, estimated: bool) -> list[str]:
    """What to say of images whose magnifications or sizes differ.

    Parameters
    ----------
    scales, sizes_px : (M,), (M, 2) of the images registered
    estimated : the prior is wider than that of the options

    """
    notes = []
    if estimated:
        spread = float(np.ptp(np.log(scales)))
        notes.append(
            f"the magnification differs between the images by up to {100 * spread:.1f} %, more "
            "than that of a microscope left alone: refocused, zoomed or scaled images; the cameras "
            "have it, with a prior as wide as the images show"
        )
    low, high = sizes_px.min(axis=0), sizes_px.max(axis=0)
    if np.any(high > low):
        notes.append(
            f"the images differ in size, from {low[0]:.0f} x {low[1]:.0f} to {high[0]:.0f} x "
            f"{high[1]:.0f} px: cropped ones do no harm, but images that were scaled or stretched "
            "to their sizes have wrong angles; give them as the microscope wrote them"
        )
    return notes
