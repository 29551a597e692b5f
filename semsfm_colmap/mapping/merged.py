"""Several series of one specimen in one model: how each stands in it, and whether it is tied to it.

Images of another mounting, axis or magnification hang together with the rest by the points that
are seen in both alone. Each series turns about an axis of its own, which in the world is the
specimen's: the angle between two such axes is what dual tilt is made for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from semsfm_colmap.motion.axis import fit_axis
from semsfm_colmap.types import Float, Int, Reconstruction

MIN_SERIES_IMAGES = 3
"""Fewer of a series do not show how it turned."""
MIN_SHARED_POINTS = 30
"""Points that a series must share with the others: they fix seven numbers (turn, shift, scale), and
a few score that agree by chance are what an image of another specimen comes in with."""


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
    magnification: float
    """geometric mean, relative to that of the first series"""
    magnification_sigma: float | None
    """relative standard deviation of that, as if its images were independent"""
    axis_world: Float | None
    """(3,) about which it turned; None: it did not"""
    range_deg: float
    """largest minus smallest angle about it"""


def places_in(
    reconstruction: Reconstruction,
    given: Sequence[str],
    series_idx: Int,
    series_names: Sequence[str],
) -> list[SeriesPlace]:
    """Where each series stands in a model.

    Parameters
    ----------
    given : names of all images, those that are not in the model too
    series_idx : (len(given),) number of the series of each
    series_names : of all series

    """
    number = dict(zip(given, series_idx.tolist(), strict=True))
    series = np.array([number[name] for name in reconstruction.image_names], dtype=np.int64)
    obs = reconstruction.observations.select(reconstruction.inlier)
    seen = np.zeros((len(reconstruction.points), len(series_names)), dtype=bool)
    seen[obs.track_idx, series[obs.image_idx]] = True
    shared = seen.sum(axis=1) > 1
    log_scale = np.log(reconstruction.cameras.scale_px_per_unit)
    means = [
        log_scale[series == k].mean() if np.any(series == k) else np.nan
        for k in range(len(series_names))
    ]
    return [
        _place(
            reconstruction,
            np.flatnonzero(series == k),
            np.flatnonzero(series == 0),
            name=name,
            num_given=int(np.sum(series_idx == k)),
            num_shared=int(np.sum(seen[:, k] & shared)),
            magnification=float(np.exp(means[k] - means[0])),
        )
        for k, name in enumerate(series_names)
    ]


def _place(
    reconstruction: Reconstruction,
    images: Int,
    first: Int,
    *,
    name: str,
    num_given: int,
    num_shared: int,
    magnification: float,
) -> SeriesPlace:
    turn = fit_axis(reconstruction.cameras.cam_from_world[images]) if len(images) > 1 else None
    sigma = None
    if reconstruction.sigma_scale is not None and len(images) and len(first):
        variance = [np.mean(reconstruction.sigma_scale[k] ** 2) / len(k) for k in (images, first)]
        sigma = float(np.sqrt(sum(variance)))
    return SeriesPlace(
        name=name,
        num_given=num_given,
        num_images=len(images),
        num_shared=num_shared,
        magnification=magnification,
        magnification_sigma=sigma,
        axis_world=None if turn is None else turn.axis_world,
        range_deg=0.0 if turn is None else float(np.rad2deg(turn.range_rad)),
    )


def series_apart(places: Sequence[SeriesPlace]) -> str | None:
    """The sentence that refuses a model which lacks a series, or holds it by too little."""
    for place in places:
        if place.num_images < min(MIN_SERIES_IMAGES, place.num_given):
            return (
                f"the series {place.name} has nothing in common with the others: {place.num_images}"
                f" of its {place.num_given} images can be tied to them; give series of the same "
                "specimen that see it from partly the same side"
            )
        if place.num_shared < MIN_SHARED_POINTS:
            return (
                f"the series {place.name} is tied to the others by {place.num_shared} points only, "
                f"fewer than {MIN_SHARED_POINTS}: how it lies to them would be a guess; add images "
                "between the two, or a series that sees both sides"
            )
    return None


def series_notes(places: Sequence[SeriesPlace]) -> list[str]:
    """What to say of each series in the model."""
    first = places[0]
    notes = []
    for place in places:
        text = (
            f"series {place.name}: {place.num_images} of {place.num_given} images, turned by "
            f"{place.range_deg:.1f} deg, {place.num_shared} points shared"
        )
        if place is not first:
            text += f"; {place.magnification:.4f} times the magnification of {first.name}"
            angle = axis_angle_deg(first, place)
            if angle is not None:
                text += f", about an axis {angle:.1f} deg from that of {first.name}"
        notes.append(text)
    return notes


def axis_angle_deg(first: SeriesPlace, second: SeriesPlace) -> float | None:
    """Angle between the axes of two series, 0 to 90: an axis has no sense."""
    if first.axis_world is None or second.axis_world is None:
        return None
    cosine = abs(float(first.axis_world @ second.axis_world))
    return float(np.rad2deg(np.arccos(min(cosine, 1.0))))
