"""Doubts about points, observations and the scale of the world."""

from __future__ import annotations

from collections.abc import Iterator

from semsfm_colmap.report.doubt import NO_ERROR, WHOLE, Doubt
from semsfm_colmap.report.metrics import Metrics
from semsfm_colmap.report.number_text import number, percent

MAX_REJECTED_FRACTION = 0.3
"""RANSAC and the filters are built for matches of which most are right."""
MIN_MULTI_VIEW_FRACTION = 0.5
"""Points seen twice add nothing to the metric shape; half of them should be seen more often."""
MAX_SCALE_MISMATCH = 0.01
"""Pixel size and model scale must agree: the vendors' pixel sizes are good to 1 to 3 %, but both
come from the same number."""


def _points(m: Metrics) -> Iterator[Doubt]:
    structure = m.structure
    fraction = structure.num_points_in_3_or_more_images / structure.num_points
    if fraction < MIN_MULTI_VIEW_FRACTION:
        yield Doubt(
            size=NO_ERROR,
            title=f"only {percent(fraction, 0)} of the points are seen three times",
            sentence=(
                f"Only {percent(fraction)} of the points are seen in three or more images; the "
                "others add nothing to the metric shape."
            ),
            action="smaller steps between the images, or more pairs (--matching.overlap 10)",
        )
    rejected = structure.rejected_fraction
    if rejected is not None and rejected > MAX_REJECTED_FRACTION:
        yield Doubt(
            size=0.01,
            title=f"{percent(rejected, 0)} of the observations were rejected",
            sentence=f"{percent(rejected)} of all observations were rejected as outliers.",
            action="look for images of another specimen or magnification, for a background that "
            "does not move (--masks auto), and for charging",
        )


def _scale(m: Metrics) -> Iterator[Doubt]:
    world = m.world
    scale, nm = world.median_scale_px_per_world, world.pixel_size_nm
    if world.unit != "um":
        yield Doubt(
            size=NO_ERROR,
            title="no pixel size: lengths are in px",
            sentence="No pixel size is known: every length of the result is in pixels of the "
            "images, none in micrometres.",
            action="give it: --pixel_size_um, or --scale_bar_um with what is written at the "
            "burnt-in scale bar, or a column pixel_size_um in --series_csv",
            covers=("no file records a pixel size",),
        )
    elif nm is not None and scale is not None:
        ratio = scale * nm / 1000.0
        if abs(ratio - 1.0) > MAX_SCALE_MISMATCH:
            yield Doubt(
                size=abs(ratio - 1.0),
                title="scale of the model and pixel size disagree",
                sentence=(
                    f"The scale of the model and the pixel size disagree by a factor of "
                    f"{number(ratio, 4)}: lengths in micrometres are off by as much."
                ),
                action="give the right --pixel_size_um and map again; a model that another "
                "program has scaled needs `semsfm adopt`",
            )


def doubts_about_points(m: Metrics) -> Iterator[Doubt]:
    """Points, scale, and the pinhole camera written for COLMAP."""
    if m.structure.num_points == 0:
        yield Doubt(
            size=2.0 * WHOLE,
            title="there are no points",
            sentence="There are no points: no image could be placed in space.",
            action="`semsfm inspect IMAGES` says what is wrong with the images; steps of 3 to 5 "
            "degrees and a specimen with structure are needed",
        )
        return
    yield from _points(m)
    yield from _scale(m)
    if m.telecentric is not None and m.residuals is not None:
        deviation = m.telecentric.max_deviation_px
        sigma = m.residuals.rms_per_coordinate_px
        if deviation > sigma:
            yield Doubt(
                size=NO_ERROR,
                title="COLMAP's pinhole camera is not parallel enough",
                sentence=(
                    "The pinhole camera written for COLMAP departs from parallel projection by up "
                    f"to {number(deviation)} px, more than the residuals ({number(sigma)} px)."
                ),
                action="give a smaller --export.max_deviation_px and map again",
            )
