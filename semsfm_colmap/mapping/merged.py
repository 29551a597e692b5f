"""Several series of one specimen in one model: how each stands in it, and whether it is tied to it.

Images of another mounting, axis or magnification hang together with the rest by the points that
are seen in both alone. Each series turns about an axis of its own, which in the world is the
specimen's: the angle between two such axes is what dual tilt is made for.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from semsfm_colmap.motion.axis import fit_axis
from semsfm_colmap.records import SeriesSigma
from semsfm_colmap.refinement.refine import Refined
from semsfm_colmap.refinement.uncertainty import Uncertainty
from semsfm_colmap.types import Float, Int, Reconstruction

MIN_SERIES_IMAGES = 3
"""Fewer of a series do not show how it turned."""
MIN_SHARED_POINTS = 30
"""Points that a series must share with the others: they fix seven numbers (turn, shift, scale), and
a few score that agree by chance are what an image of another specimen comes in with."""

PIXEL_SIZE_TOLERANCE = 0.05
"""Relative: makers of microscopes promise a few per cent for the pixel sizes that they record."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SeriesPlace:
    """A series in the model of several."""

    name: str
    num_given: int
    """images that it has"""
    num_images: int
    """of them in the model"""
    num_shared: int
    """points seen in it and in another series"""
    log_scale: float
    """mean logarithm of the magnification; nan without images"""
    pixel_size_um: float | None
    """as recorded or given for the series by itself"""
    axis_world: Float | None
    """(3,) about which it turned; None: it did not"""
    range_deg: float
    """largest minus smallest angle about it"""
    in_plane_deg: float
    """turn in the image plane against the first series, where the two look along most nearly the
    same line; nan without images"""


def places_in(
    reconstruction: Reconstruction,
    given: Sequence[str],
    series_idx: Int,
    series_names: Sequence[str],
    pixel_sizes_um: Sequence[float | None],
) -> list[SeriesPlace]:
    """Where each series stands in a model.

    Parameters
    ----------
    given : names of all images, those that are not in the model too
    series_idx : (len(given),) number of the series of each
    series_names, pixel_sizes_um : of all series

    """
    number = dict(zip(given, series_idx.tolist(), strict=True))
    series = np.array([number[name] for name in reconstruction.image_names], dtype=np.int64)
    obs = reconstruction.observations.select(reconstruction.inlier)
    seen = np.zeros((len(reconstruction.points), len(series_names)), dtype=bool)
    seen[obs.track_idx, series[obs.image_idx]] = True
    shared = seen.sum(axis=1) > 1
    R = reconstruction.cameras.cam_from_world
    log_scale = np.log(reconstruction.cameras.scale_px_per_unit)
    places = []
    for k, name in enumerate(series_names):
        mine = series == k
        turn = fit_axis(R[mine]) if mine.sum() > 1 else None
        places.append(
            SeriesPlace(
                name=name,
                num_given=int(np.sum(series_idx == k)),
                num_images=int(mine.sum()),
                num_shared=int(np.sum(seen[:, k] & shared)),
                log_scale=float(log_scale[mine].mean()) if mine.any() else math.nan,
                pixel_size_um=pixel_sizes_um[k],
                axis_world=None if turn is None else turn.axis_world,
                range_deg=0.0 if turn is None else float(np.rad2deg(turn.range_rad)),
                in_plane_deg=in_plane_turn_deg(R[series == 0], R[mine]),
            )
        )
    return places


def in_plane_turn_deg(first: Float, second: Float) -> float:
    """Turn about the viewing direction from one series to another, -180 to 180; nan without images.

    Of the images that look along most nearly the same line, ``Q = R_second R_first^T`` is nearest
    to a rotation about z by ``atan2(Q_10 - Q_01, Q_00 + Q_11)``.

    Parameters
    ----------
    first, second : (M, 3, 3), (N, 3, 3) rotations of the cameras

    """
    if not len(first) or not len(second):
        return math.nan
    i, j = np.unravel_index(np.argmax(first[:, 2] @ second[:, 2].T), (len(first), len(second)))
    Q = second[j] @ first[i].T
    return float(np.rad2deg(np.arctan2(Q[1, 0] - Q[0, 1], Q[0, 0] + Q[1, 1])))


def series_apart(places: Sequence[SeriesPlace]) -> str | None:
    """The sentence that refuses a model which lacks a series, or holds it by too little."""
    for place in places:
        if place.num_images < min(MIN_SERIES_IMAGES, place.num_given):
            return (
                f"the series {place.name} has nothing in common with the others: {place.num_images}"
                f" of its {place.num_given} images can be tied to them; give series of the same "
                "specimen that see it from partly the same side"
            )
    for place in places:
        if place.num_shared < MIN_SHARED_POINTS:
            return (
                f"the series {place.name} is tied to the others by {place.num_shared} points only, "
                f"fewer than {MIN_SHARED_POINTS}: how it lies to them would be a guess; add images "
                "between the two, or a series that sees both sides"
            )
    return None


def series_notes(
    places: Sequence[SeriesPlace], sigmas: Sequence[SeriesSigma] | None = None
) -> list[str]:
    """What to say of each series in the model.

    Parameters
    ----------
    sigmas : of each but the first; None where they are not known

    """
    first = places[0]
    notes = []
    for number, place in enumerate(places):
        text = (
            f"series {place.name}: {place.num_images} of {place.num_given} images, turned by "
            f"{place.range_deg:.1f} deg, {place.num_shared} points shared"
        )
        if place is not first:
            ratio = math.exp(place.log_scale - first.log_scale)
            text += (
                f"; turned by {place.in_plane_deg:.0f} deg in the image plane against {first.name}"
                f", {ratio:.4f} times its magnification"
            )
            if first.pixel_size_um and place.pixel_size_um:
                recorded = first.pixel_size_um / place.pixel_size_um
                text += f" ({recorded:.4f} times by the pixel sizes"
                wrong = abs(math.log(ratio / recorded)) > PIXEL_SIZE_TOLERANCE
                text += ": one of the two is wrong)" if wrong else ")"
            angle = axis_angle_deg(first, place)
            if angle is not None:
                text += f", about an axis {angle:.1f} deg from its axis"
            if sigmas is not None:
                sigma = sigmas[number - 1]
                text += (
                    f"; how it lies to {first.name} is known to {sigma.turn_deg:.2f} deg about "
                    f"each axis and {100 * sigma.scale:.2f} % of the magnification, one sigma"
                )
        notes.append(text)
    return notes


def series_sigmas(
    refined: Refined, uncertainty: Uncertainty | None
) -> tuple[SeriesSigma, ...] | None:
    """How well it is known how each series lies to the first.

    With w_i the rotation vector by which image i errs, in its camera's frame, and l_i the logarithm
    of its magnification, the turn of series k against the first one errs by

        mean_k R_i^T w_i - mean_0 R_i^T w_i   in the world, its ratio by   mean_k l_i - mean_0 l_i.

    Returns
    -------
    of all series in the model but the first; None where there is one, or no error bars

    """
    series = refined.cameras.series_idx
    if series is None or uncertainty is None or refined.cameras.num_series < 2:
        return None
    R = np.asarray(refined.cameras.cam_from_world)
    idx = refined.adjustment.model.param_idx
    num_params = len(uncertainty.noise.cameras.gauge)
    means = []
    for k in np.unique(series):
        mine = np.flatnonzero(series == k)
        mean = np.zeros((num_params + 1, 4))  # index -1, of a magnification that is not free
        mean[idx[mine, :3], :3] = R[mine] / len(mine)
        mean[idx[mine, 3], 3] = 1.0 / len(mine)
        means.append(mean[:-1])
    found = []
    for mean in means[1:]:
        *turn, scale = (uncertainty.sigma(column) for column in (mean - means[0]).T)
        turn_rad = float(np.sqrt(np.mean(np.square(turn))))
        found.append(SeriesSigma(turn_deg=math.degrees(turn_rad), scale=scale))
    return tuple(found)


def axis_angle_deg(first: SeriesPlace, second: SeriesPlace) -> float | None:
    """Angle between the axes of two series, 0 to 90: an axis has no sense."""
    if first.axis_world is None or second.axis_world is None:
        return None
    cosine = abs(float(first.axis_world @ second.axis_world))
    return float(np.rad2deg(np.arccos(min(cosine, 1.0))))
