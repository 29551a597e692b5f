"""One pixel size for the series, from the option or from what the files agree on."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from semsfm_colmap.ingest.frame.source import SourceImage
from semsfm_colmap.io.wording import abbreviate
from semsfm_colmap.types import SemFrame

SAME_MAGNIFICATION = 0.005
"""Relative spread of recorded pixel sizes still called one magnification: they are rounded to 3-4
digits, and a magnification drifts by up to 0.3 %."""


OTHER_MAGNIFICATION = 0.03
"""Beyond this a view cannot be placed: parallel views are related by their angles only if they have
one magnification, so the reconstruction allows it to vary by per mills. An image of 0.7 times the
magnification came out turned by 40 degrees."""


@dataclass(frozen=True, kw_only=True)
class SeriesPixelSize:
    """The pixel size of a series, its source, and what the user should know."""

    um: float | None
    source: str
    warnings: tuple[str, ...] = ()


def leave_out_magnifications(
    images: Sequence[SourceImage], option_um: float | None
) -> tuple[list[SourceImage], list[str]]:
    """Keep the images of the magnification that most record; those that record none stay."""
    sizes = np.array([i.reading.metadata.pixel_size_um or np.nan for i in images])
    known = sizes[np.isfinite(sizes)]
    if option_um is not None or len(known) < 2:
        return list(images), []
    near = np.abs(known[:, None] / known - 1) <= OTHER_MAGNIFICATION
    usual = float(np.median(known[near[int(near.sum(axis=1).argmax())]]))
    other = np.abs(sizes / usual - 1) > OTHER_MAGNIFICATION
    if not other.any():
        return list(images), []
    names = [image.name for image, odd in zip(images, other, strict=True) if odd]
    least, most = float(sizes[other].min()), float(sizes[other].max())
    of = (
        f"{least:.6g} um"
        if most / least < 1 + SAME_MAGNIFICATION
        else f"{least:.6g} to {most:.6g} um"
    )
    sentence = (
        f"{abbreviate(names)}: a pixel size of {of} is recorded, but {usual:.6g} um for most "
        "images, and views of another magnification cannot be placed; give pixel_size_um or a "
        "table if that is wrong. Left out."
    )
    return [image for image, odd in zip(images, other, strict=True) if not odd], [sentence]


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
