"""Doubts about images: missing, in other models, apart from the rest, drifting, magnified."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from semsfm_colmap.report.doubt import NO_ERROR, Doubt
from semsfm_colmap.report.image_statistics import PoseMetrics
from semsfm_colmap.report.magnification_trend import MAX_SPAN
from semsfm_colmap.report.metrics import Metrics
from semsfm_colmap.report.number_text import count, listed, number, percent
from semsfm_colmap.report.trust_text import disagreement, largest_drift_px, relative_sigma

BEND = 0.1
"""Relative error of the angles for each relative change of the magnification that a model leaves
out, at some tens of degrees."""
MAX_DRIFT_PX = 0.5
"""Two and a half standard deviations of the drift within a frame that is expected (0.2 px): more
than half a pixel is a stage that creeps or a specimen that charges."""
DRIFT_SIZE = 0.002
"""Relative error of lengths along the rows' direction that a drift of a pixel stands for."""
MIN_SHARED_TRACKS = 10
"""A window of the factorization needs this many common tracks to hold its images together."""
BAD_IMAGE_FACTOR = 2.0
"""An image whose residuals are this many times the median of all stands out."""
FEWER_STEPS = (
    "look at these images for blur, charging or another framing; smaller steps between the images, "
    "or more pairs (--matching.overlap 10), give them more in common"
)
Posed = list[tuple[str, PoseMetrics]]


def _parts(m: Metrics) -> Iterator[Doubt]:
    """A series that fell into models of their own, and images that are in none."""
    models = [model for model in m.models if model.kind == "model"]
    elsewhere = {name: model.model for model in models[1:] for name in model.images}
    if len(models) > 1:
        # where one model ends and another begins, in the order of acquisition
        of = {name: model.model for model in models for name in model.images}
        names = [image.name for image in m.per_image if image.name in of]
        gaps = [f"{a} – {b}" for a, b in pairwise(names) if of[a] != of[b]]
        sizes = ", ".join(f"{model.model} has {len(model.images)}" for model in models)
        yield Doubt(
            size=NO_ERROR,
            title=f"the series falls into {len(models)} models",
            sentence=(
                f"The series falls into {len(models)} models that share too few points; each has "
                f"its own scale and axes, and this page is of the first ({sizes} of "
                f"{count(m.images.num_given, 'image')})."
            ),
            action=f"add images between {listed(gaps)}, or match more pairs "
            "(--matching.overlap 10, --features.max_num_features 16384)",
            covers=("the series falls into", f"{len(m.images.missing)} of "),
        )
    missing = [name for name in m.images.missing if name not in elsewhere]
    if missing:
        yield Doubt(
            size=NO_ERROR,
            title=f"{count(len(missing), 'image')} could not be registered",
            sentence=f"{count(len(missing), 'image')} could not be registered: {listed(missing)}.",
            action=FEWER_STEPS,
            covers=(f"{len(m.images.missing)} of ",),
        )


def _apart(rows: Posed) -> Iterator[Doubt]:
    """Images whose residuals stand out."""
    rms = np.array([pose.rms_px or np.nan for _, pose in rows])
    if not np.isfinite(rms).any():
        return
    middle = float(np.nanmedian(rms))
    names = [
        name for (name, _), one in zip(rows, rms, strict=True) if one > BAD_IMAGE_FACTOR * middle
    ]
    if names:
        yield Doubt(
            size=0.01,
            title=f"{count(len(names), 'image')} with large residuals",
            sentence=(
                f"{count(len(names), 'image')} with residuals over {BAD_IMAGE_FACTOR:.0f} times "
                f"the median of all ({number(middle)} px): {listed(names)}."
            ),
            action="look at them for blur, charging or a jump of the stage, and leave them out to "
            "see what changes",
        )


def _magnification(m: Metrics, rows: Posed) -> Iterator[Doubt]:
    """A magnification that follows the angle, or spreads."""
    seen = None if m.reliability is None else m.reliability.perspective
    if not rows or (seen is not None and seen.used):
        return  # with perspective each image has a distance of its own
    scale = np.array([pose.relative_scale for _, pose in rows])
    spread = float(np.ptp(scale))
    trend, apart = m.magnification_trend, disagreement(m)
    if trend is not None and trend.is_doubtful(apart, relative_sigma(m)):
        yield Doubt(
            size=max(BEND * trend.span, apart),
            title=f"the magnification runs with the angle by {percent(trend.span, 2)}",
            sentence=(
                f"The magnification runs with the angle: {percent(trend.span, 2)} of change "
                f"follow it, {percent(trend.share, 0)} of its variance. The camera models that the "
                f"images do not rule out differ by {percent(apart, 2)} in the angles."
            ),
            action="keep the specimen on the tilt axis and refocus with the stage, not the lens; "
            "of a microscope that was left alone compare --refinement.camera_model orthographic; "
            "known tilts settle it",
            covers=("the magnification differs between the images",),
        )
    elif spread > 2.0 * MAX_SPAN:
        yield Doubt(
            size=BEND * spread,
            title=f"the magnification spreads over {percent(spread, 2)}",
            sentence=(
                f"The magnification spreads over {percent(spread, 2)} between images; more than "
                f"±{percent(MAX_SPAN)} is unusual for a microscope left alone, and a wrong "
                "magnification bends the angles."
            ),
            action="give the images as the microscope wrote them, neither scaled nor stretched; if "
            "it was refocused or zoomed, the cameras have it",
            covers=("the magnification differs between the images",),
        )


def _drift(m: Metrics) -> Iterator[Doubt]:
    """A drift within the frames: taken out, but large; or left in."""
    action = (
        "scan faster or with drift correction, and wait longer after each move; of a specimen that "
        "charges lower the beam's energy or current"
    )
    left = None if m.reliability is None else m.reliability.scan_drift
    taken = largest_drift_px(m)
    if left is not None and left.best:
        yield Doubt(
            size=DRIFT_SIZE * left.largest_px,
            title=f"a scan drift of {number(left.largest_px, 2)} px is left in the frames",
            sentence=(
                f"Rows within the frames are displaced, the last against the first by up to "
                f"{number(left.largest_px, 2)} px, and the cameras written do not have it."
            ),
            action=action,
            covers=("rows within the frames are displaced",),
        )
    elif taken > MAX_DRIFT_PX:
        yield Doubt(
            size=DRIFT_SIZE * taken,
            title=f"the specimen drifted by up to {number(taken, 2)} px within a frame",
            sentence=(
                f"The specimen drifted while the frames were scanned, by up to {number(taken, 2)} "
                "px from the first row to the last. A steady drift was taken out of the "
                "observations and is in the error bars; one that changes within a frame is not."
            ),
            action=action,
            covers=("the specimen drifted while the frames were scanned",),
        )


def _links(m: Metrics, rows: Posed) -> Iterator[Doubt]:
    """Neighbouring images that share too little."""
    shared = np.diagonal(m.co_visibility.num_shared_tracks, offset=1)
    links = [f"{rows[k][0]} – {rows[k + 1][0]}" for k in np.flatnonzero(shared < MIN_SHARED_TRACKS)]
    if links:
        yield Doubt(
            size=0.01,
            title=f"{count(len(links), 'weak link')} between neighbouring images",
            sentence=(
                f"Weak links, with fewer than {MIN_SHARED_TRACKS} points shared by neighbouring "
                f"images: {listed(links)}."
            ),
            action="add images in between, or match more pairs (--matching.overlap 10)",
        )


def doubts_about_images(m: Metrics) -> Iterator[Doubt]:
    """All that one image or another is to blame for."""
    rows = [(image.name, image.pose) for image in m.per_image if image.pose is not None]
    yield from _parts(m)
    yield from _apart(rows)
    yield from _magnification(m, rows)
    yield from _drift(m)
    yield from _links(m, rows)
