"""One pixel size for the series, from the option or from what the files agree on."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from semsfm_colmap.ingest.wording import abbreviate
from semsfm_colmap.types import SemFrame

SAME_MAGNIFICATION = 0.005
"""Relative spread of recorded pixel sizes still called one magnification: they are rounded to 3-4
digits, and a magnification drifts by up to 0.3 %."""


@dataclass(frozen=True, kw_only=True)
class SeriesPixelSize:
    """The pixel size of a series, its source, and what the user should know."""

    um: float | None
    source: str
    warnings: tuple[str, ...] = ()


def series_pixel_size(frames: Sequence[SemFrame], option_um: float | None) -> SeriesPixelSize:
    """The option wins; else the median of the recorded sizes; else none, and the world is in px."""
    known = [f for f in frames if f.metadata.pixel_size_um is not None]
    sizes = np.array([f.metadata.pixel_size_um for f in known], dtype=np.float64)
    warnings: list[str] = []
    median = float(np.median(sizes)) if len(sizes) else None
    if option_um is not None:
        if median is not None and abs(median / option_um - 1) > SAME_MAGNIFICATION:
            warnings.append(
                f"pixel_size_um = {option_um:g} is used although the files say {median:.6g}."
            )
        return SeriesPixelSize(um=option_um, source="option pixel_size_um", warnings=(*warnings,))
    if median is None:
        return SeriesPixelSize(
            um=None,
            source="none",
            warnings=(
                "no file records a pixel size, so the result is in px; give pixel_size_um for "
                "micrometres.",
            ),
        )
    missing = [f.name for f in frames if f.metadata.pixel_size_um is None]
    if missing:
        warnings.append(
            f"{abbreviate(missing)}: no pixel size recorded; that of the other images is assumed."
        )
    odd = [
        f.name
        for f, um in zip(known, sizes, strict=True)
        if abs(um / median - 1) > SAME_MAGNIFICATION
    ]
    if odd:
        warnings.append(
            f"{abbreviate(odd)}: the recorded pixel size differs from the series' median of "
            f"{median:.6g} um by more than {SAME_MAGNIFICATION:.1%}: check the magnification."
        )
    source = Counter(f.metadata.source.get("pixel_size_um", "recorded") for f in known)
    return SeriesPixelSize(um=median, source=source.most_common(1)[0][0], warnings=(*warnings,))
