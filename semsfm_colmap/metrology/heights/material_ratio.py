"""The material ratio curve (Abbott curve) of heights, and what is read off it.

The heights z_1 >= z_2 >= ... >= z_N, each for the same length or area, stand at the material
ratios ``p_i = (i - 1/2) / N``; between them the curve c(p) is straight, beyond the first and the
last it is level. It serves profiles (ISO 21920-2) and height maps (ISO 25178-2) alike.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from semsfm_colmap.types import Float

CORE = 0.4
"""Share of the curve that the equivalent straight line is fitted to [ISO 25178-2]."""
VOID_AND_CORE = (0.1, 0.8)
"""Material ratios between peaks and core, and between core and dales, defaults of ISO 25178-3."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MaterialRatio:
    """The curve c(p): height at which the share p of the surface is material."""

    heights: Float
    """(N,) from the highest to the lowest"""

    @classmethod
    def of(cls, heights: Float) -> MaterialRatio:
        """The curve of heights, nan left out."""
        known = heights[np.isfinite(heights)]
        return cls(heights=np.sort(known)[::-1])

    @property
    def ratio(self) -> Float:
        """(N,) p of each height."""
        num = len(self.heights)
        return (np.arange(num) + 0.5) / num

    def height(self, ratio: float) -> float:
        """Smc(mr): the height c at a material ratio p in 0..1."""
        return float(np.interp(ratio, self.ratio, self.heights))

    def at(self, height: float) -> float:
        """Smr(c): the material ratio p in 0..1 at a height: 0 above the highest, 1 below all."""
        if height > self.heights[0]:
            return 0.0
        if height < self.heights[-1]:
            return 1.0
        return float(np.interp(-height, -self.heights, self.ratio))

    def integral(self, first: float, last: float) -> float:
        """Integral of c(p) over p from `first` to `last`, exact for the straight pieces."""
        p = self.ratio
        inside = (p > first) & (p < last)
        place = np.concatenate([[first], p[inside], [last]])
        return float(np.trapezoid(np.interp(place, p, self.heights), place))

    def material_volume(self, ratio: float) -> float:
        """Vm(p) = integral from 0 to p of ``c(q) - c(p)`` dq: volume per area above c(p)."""
        return self.integral(0.0, ratio) - ratio * self.height(ratio)

    def void_volume(self, ratio: float) -> float:
        """Vv(p) = integral from p to 1 of ``c(p) - c(q)`` dq: volume per area below c(p)."""
        return (1.0 - ratio) * self.height(ratio) - self.integral(ratio, 1.0)

    def core(self) -> CoreParameters:
        """The equivalent straight line and the parameters of the Sk family [ISO 25178-2].

        The secant over 40 % of the curve that is least steep (the first of several) marks the part
        whose least-squares line ``a + b p`` is drawn on to p = 0 and p = 1: ``k = -b`` is the depth
        of the core, Mr1 and Mr2 the ratios where the curve has the line's heights there. ``A1 =
        integral from 0 to Mr1 of c(p) - a`` is the area of a triangle of height pk over Mr1,
        ``A2 = integral from Mr2 to 1 of a + b - c(p)`` one of height vk over 1 - Mr2.
        """
        p, z = self.ratio, self.heights
        num = len(z)
        width = max(round(CORE * num), 2)
        fall = z[: num - width + 1] - z[width - 1 :]
        first = int(np.argmin(fall))
        part = slice(first, first + width)
        slope, offset = np.polyfit(p[part], z[part], 1)
        top, bottom = float(offset), float(offset + slope)
        mr1, mr2 = self.at(top), self.at(bottom)
        above = self.integral(0.0, mr1) - mr1 * top
        below = (1.0 - mr2) * bottom - self.integral(mr2, 1.0)
        return CoreParameters(
            k=top - bottom,
            pk=2.0 * above / mr1 if mr1 > 0.0 else 0.0,
            vk=2.0 * below / (1.0 - mr2) if mr2 < 1.0 else 0.0,
            mr1=mr1,
            mr2=mr2,
        )


@dataclass(frozen=True, kw_only=True)
class CoreParameters:
    """Sk, Spk, Svk, Smr1, Smr2 of a surface; Rk, ... of a profile. Ratios are in 0..1."""

    k: float
    pk: float
    vk: float
    mr1: float
    mr2: float
