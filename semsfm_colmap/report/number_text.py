"""Numbers, counts and names as a person writes them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from semsfm_colmap.types import MOST_TOLD_CONFIDENCE

MAX_NAMES = 6
"""Names listed in a sentence before the rest are counted."""
PLAIN_RANGE = (1e-4, 1e9)
"""Numbers outside are written with an exponent."""
THIN_SPACE = "\u202f"
"""Narrow and unbreakable: between the digits of thousands and before the percent sign."""


def number(value: float | None, digits: int = 3) -> str:
    """A float with so many significant digits, an integer in full; a dash for what is not known."""
    if value is None or not math.isfinite(value):
        return "–"
    if isinstance(value, int) or value == 0.0:
        text = f"{int(value):,}"
    elif not PLAIN_RANGE[0] <= abs(value) < PLAIN_RANGE[1]:
        text = f"{value:.{digits - 1}e}"
    else:
        decimals = digits - 1 - int(np.floor(np.log10(abs(value))))
        text = f"{round(value, decimals):,.{max(decimals, 0)}f}"
    return text.replace(",", THIN_SPACE).replace("-", "−")


def fixed(value: float | None, digits: int) -> str:
    """So many decimals, a proper minus and none before a zero; a dash for what is not known."""
    if value is None or not math.isfinite(value):
        return "–"
    return f"{round(value, digits) + 0.0:.{digits}f}".replace("-", "−")


def measured(value: float, sigma: float | None, digits: int = 4) -> str:
    """``114.7 ± 0.3``: to the digits of the standard deviation, two where it begins with 1 or 2.

    Without one, so many significant digits.

    Examples
    --------
    >>> measured(114.7163, 0.268), measured(9.97, 1.4), measured(57.7896, 0.0437)
    ('114.72 ± 0.27', '10.0 ± 1.4', '57.79 ± 0.04')

    """
    if sigma is None or not math.isfinite(sigma) or sigma <= 0.0:
        return number(value, digits)
    leading = f"{sigma:e}"[0]
    decimals = int(leading in "12") - math.floor(math.log10(sigma))
    decimals = max(decimals, 0)
    return f"{fixed(value, decimals)} ± {fixed(sigma, decimals)}"


def count(value: int, noun: str) -> str:
    """``3 images``, ``1 image``, ``0 images``."""
    return f"{number(value)} {noun}" + ("" if value == 1 else "s")


def percent(fraction: float | None, digits: int = 1) -> str:
    """A fraction as ``12.3 %``; never rounded up to 100 %."""
    if fraction is None or not math.isfinite(fraction):
        return "–"
    shown = round(100.0 * fraction, digits)
    if fraction < 1.0 and shown >= 100.0:
        return f"> {100.0 - 10.0**-digits:.{digits}f}{THIN_SPACE}%"
    return f"{shown:.{digits}f}{THIN_SPACE}%"


def confidence(probability: float) -> str:
    """A probability as finely as it is calibrated: whole percents, and ``above 99 %``.

    Examples
    --------
    >>> [confidence(p).replace(THIN_SPACE, " ") for p in (0.5, 0.961, 0.9998)]
    ['50 %', '96 %', 'above 99 %']

    """
    if probability > MOST_TOLD_CONFIDENCE:
        return f"above 99{THIN_SPACE}%"
    if probability < 1.0 - MOST_TOLD_CONFIDENCE:
        return f"below 1{THIN_SPACE}%"
    return f"{100.0 * probability:.0f}{THIN_SPACE}%"


def listed(names: Sequence[str]) -> str:
    """The first few names and how many more there are."""
    more = len(names) - MAX_NAMES
    return ", ".join(names[:MAX_NAMES]) + (f" and {more} more" if more > 0 else "")


def unit_text(unit: str) -> str:
    """The world unit as a person writes it."""
    return {"um": "µm"}.get(unit, unit)
