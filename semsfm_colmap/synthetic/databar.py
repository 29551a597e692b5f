"""The bar of text and scale that microscopes burn into the bottom of an image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from semsfm_colmap.types import Array

DISPLAY_WIDTH_UM = 127_000.0
"""Width of the print that magnifications are quoted for: 5 inches, the Polaroid 545."""


@dataclass(frozen=True, kw_only=True)
class BarText:
    """What the databar says."""

    pixel_size_um: float
    beam_energy_kev: float
    working_distance_mm: float
    angle_name: str
    """Name of the reading that changes from image to image: "tilt" or "rot"."""


def magnification(width_px: int, pixel_size_um: float) -> float:
    """Nominal magnification of an image printed 5 inches wide."""
    return DISPLAY_WIDTH_UM / (width_px * pixel_size_um)


def length_text(length_um: float) -> str:
    """A length with its unit, as databars spell it."""
    if length_um >= 1000:
        return f"{length_um / 1000:g} mm"
    return f"{length_um:g} um" if length_um >= 1 else f"{length_um * 1000:g} nm"


def scale_bar_um(longest_um: float) -> float:
    """The longest of 1, 2, 5 x 10^n that fits."""
    power = 10.0 ** np.floor(np.log10(longest_um))
    steps = np.array([1.0, 2.0, 5.0]) * power
    return float(steps[steps <= longest_um * (1 + 1e-9)].max())


def draw_databar(
    width: int, rows: int, text: BarText, *, angle_deg: float, frame: int, num_frames: int
) -> Array:
    """Draw the bar of one image (rows, width) uint8.

    All is static but for the cell with the angle and the one with the number of the frame.
    """
    import cv2

    bar = np.zeros((rows, width), np.uint8)
    if rows < 8:
        return bar
    bar[: max(1, rows // 40)] = 230
    size = rows / 60.0
    mag = magnification(width, text.pixel_size_um)
    cells = [
        ("HV", f"{text.beam_energy_kev:.2f} kV"),
        ("mag", f"{mag:,.0f} x".replace(",", " ")),
        ("WD", f"{text.working_distance_mm:.1f} mm"),
        ("pixel", f"{text.pixel_size_um * 1000:.2f} nm"),
        (text.angle_name, f"{angle_deg:.1f} deg"),
        ("frame", f"{frame + 1}/{num_frames}"),
    ]
    pitch = max(1, round(0.68 * width / len(cells)))
    font = cv2.FONT_HERSHEY_SIMPLEX
    # Text must fit its cell in narrow images too.
    font_scale = min(0.42 * size, 0.42 * pitch / 100.0)

    def write(string: str, x: int, y: float) -> None:
        cv2.putText(bar, string, (x, round(y)), font, font_scale, 235, 1, cv2.LINE_AA)

    for k, (head, value) in enumerate(cells):
        write(head, k * pitch + round(8 * size), 0.38 * rows)
        write(value, k * pitch + round(8 * size), 0.78 * rows)
        bar[rows // 8 : -rows // 8, (k + 1) * pitch - 1] = 120
    left = len(cells) * pitch + round(12 * size)
    right = width - round(14 * size)
    length_um = scale_bar_um((right - left) * text.pixel_size_um)
    length_px = round(length_um / text.pixel_size_um)
    y = round(0.68 * rows)
    start = (left + right - length_px) // 2
    tick = round(0.09 * rows)
    cv2.line(bar, (start, y), (start + length_px, y), 235, 1)
    for x in (start, start + length_px):
        cv2.line(bar, (x, y - tick), (x, y + tick), 235, 1)
    label = length_text(length_um)
    (label_width, _), _ = cv2.getTextSize(label, font, font_scale, 1)
    write(label, start + (length_px - label_width) // 2, 0.45 * rows)
    return bar
