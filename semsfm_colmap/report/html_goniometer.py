"""The numbers of the goniometer on the page."""

from __future__ import annotations

from collections.abc import Iterator

from semsfm_colmap.records import Estimate, GoniometerRecord, ReadoutFigures
from semsfm_colmap.report.html_parts import definitions
from semsfm_colmap.report.number_text import fixed, measured, number


def _with_sigma(estimate: Estimate, unit: str) -> str:
    return f"{measured(estimate.value, estimate.sigma)}{unit}"


def _readout_rows(figures: ReadoutFigures, lag: str) -> Iterator[tuple[str, str]]:
    yield "scatter about the line", f"{fixed(figures.scatter_deg, 3)}°"
    if figures.hysteresis_deg is not None:
        yield lag, _with_sigma(figures.hysteresis_deg, "°")
    kind = "straight" if figures.is_straight else "bent"
    yield "relation", f"{kind}, bend {_with_sigma(figures.bend_deg, '°')}"


def _rows(record: GoniometerRecord) -> Iterator[tuple[str, str]]:
    factor = record.conversion_deg_per_um
    if factor is not None and record.displacement is not None:
        yield "conversion", _with_sigma(factor, "° per µm")
        yield from _readout_rows(record.displacement, "hysteresis")
    if record.tilt_ratio is not None and record.tilt is not None:
        yield "seen over recorded tilt", _with_sigma(record.tilt_ratio, "")
        yield from _readout_rows(record.tilt, "backlash")
    axis = ", ".join(fixed(c, 4) for c in record.axis_camera)
    yield "axis in the camera", f"({axis}) ± {fixed(record.axis_camera_sigma_deg, 3)}°"
    world = ", ".join(fixed(c, 4) for c in record.axis_world)
    yield "axis in the world", f"({world}) ± {fixed(record.axis_world_sigma_deg, 3)}°"
    yield "wobble", f"{fixed(record.wobble_deg_rms, 3)}° rms"
    steps = record.steps
    yield "steps", f"{number(steps.median_deg)}° median, scatter {fixed(steps.scatter_deg, 3)}°"
    yield (
        "most uneven step",
        f"{fixed(steps.largest_departure_deg, 2)}° off, to {steps.largest_departure_image}",
    )
    if record.turn is not None:
        yield (
            "step that closes the turn",
            f"{number(record.turn.closing_step_deg)}°, "
            f"{fixed(record.turn.minus_median_step_deg, 3)}° over the median",
        )
    circle = record.eccentricity
    if circle is not None:
        size = _with_sigma(circle.radius_px, " px")
        if circle.radius_um is not None:
            size += f" = {_with_sigma(circle.radius_um, ' µm')}"
        yield "specimen beside the axis", size
        drift = ", ".join(fixed(d, 1) for d in circle.drift_px_per_turn)
        yield "drift in a turn (x, y)", f"{drift} px"


def goniometer_table(record: GoniometerRecord) -> str:
    """The key numbers."""
    return definitions(_rows(record))
