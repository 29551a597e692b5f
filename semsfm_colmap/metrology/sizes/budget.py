"""Measured values with their uncertainty budgets, as the GUM has them (JCGM 100:2008).

The standard uncertainty is ``u^2 = sum_i u_i^2`` over the sources, which are independent of one
another; the share of a source is ``u_i^2 / u^2``. The expanded uncertainty is ``U = k u`` with
k = 1.96: as no source of kind A rests on few degrees of freedom, the distribution is taken as
normal and the interval ``value -+ U`` holds 95 %.

A known length L of standard uncertainty u_L is compared by ``E_n = (x - L) / sqrt(U^2 + U_L^2)``
(ISO 13528, ISO/IEC 17043): |E_n| <= 1 is agreement.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from semsfm_colmap.metrology.sizes.covariance import Errors, Source
from semsfm_colmap.metrology.sizes.quantities import Quantity

FOLDED = (
    "within two standard uncertainties of 0 or 180 degrees, beyond which no angle goes: the true "
    "one may well be 0 or 180, and the interval is not symmetric"
)
"""Remark on an angle that may be none."""
COVERAGE_FACTOR = 1.96
"""k for 95 % of a normal distribution."""


@dataclass(frozen=True, kw_only=True)
class Check:
    """Comparison with a known length."""

    length: float
    sigma: float
    deviation: float
    """measured minus known"""
    en: float

    @property
    def agrees(self) -> bool:
        """Whether |E_n| <= 1."""
        return abs(self.en) <= 1.0


@dataclass(frozen=True, kw_only=True)
class Measurement:
    """A value and all that is known of it."""

    name: str
    what: str
    """kind and places in words"""
    value: float
    sigma: float
    unit: str
    sources: tuple[Source, ...]
    not_assessed: tuple[str, ...]
    facts: Mapping[str, float] = field(default_factory=dict)
    """what else was found, such as the form deviation of a fit"""
    remarks: tuple[str, ...] = ()
    """sentences that must be read with the value"""
    check: Check | None = None
    profile: tuple[tuple[float, float, float], ...] = ()
    """(along, height, sigma of the height) of samples"""

    @property
    def expanded(self) -> float:
        """U, for 95 %."""
        return COVERAGE_FACTOR * self.sigma

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval."""
        return self.value - self.expanded, self.value + self.expanded

    def share(self, source: Source) -> float:
        """Of the variance, 0 to 1."""
        return source.contribution**2 / self.sigma**2 if self.sigma > 0.0 else 0.0


def measurement(
    quantity: Quantity,
    errors: Errors,
    name: str,
    what: str,
    *,
    known: tuple[float, float] | None = None,
    profile: tuple[tuple[float, float, float], ...] = (),
) -> Measurement:
    """A value with its budget.

    Parameters
    ----------
    known : length and its standard uncertainty to compare with

    """
    if quantity.dimension == 0:
        quantity = quantity.scaled(180.0 / np.pi)
    sources = tuple(errors.sources(quantity))
    sigma = standard_uncertainty(sources)
    remarks = quantity.remarks
    if quantity.dimension == 0 and min(quantity.value, 180.0 - quantity.value) < 2.0 * sigma:
        remarks = (*remarks, FOLDED)
    check = None
    if known is not None:
        apart = quantity.value - known[0]
        both = COVERAGE_FACTOR * float(np.hypot(sigma, known[1]))
        en = apart / both if both > 0.0 else float(np.copysign(np.inf, apart))
        check = Check(length=known[0], sigma=known[1], deviation=apart, en=en)
    return Measurement(
        name=name,
        what=what,
        value=quantity.value,
        sigma=sigma,
        unit=unit_of(quantity.dimension, errors.unit),
        sources=tuple(sorted(sources, key=lambda source: -source.contribution)),
        not_assessed=tuple(errors.not_assessed(quantity)),
        facts=quantity.facts,
        remarks=remarks,
        check=check,
        profile=profile,
    )


def standard_uncertainty(sources: tuple[Source, ...] | list[Source]) -> float:
    """``sqrt(sum u_i^2)``."""
    return float(np.sqrt(sum(source.contribution**2 for source in sources)))


def unit_of(dimension: int, unit: str) -> str:
    """Of a value of so many lengths."""
    return "deg" if dimension == 0 else unit if dimension == 1 else f"{unit}^{dimension}"
