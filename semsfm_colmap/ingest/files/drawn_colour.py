"""Colour in a grey image is drawn: annotations, measured lengths, logos, a coloured databar.

An electron micrograph is grey, also where it is stored as RGB. So in an image of which all the rest
is grey to the last digit, coloured pixels were drawn over it, in a few exact colours. Photographs,
whose grey is never exact, and micrographs tinted by hand, whose tint has as many shades as the
image below it, are no such images.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from semsfm_colmap.types import Array, Bool

MIN_PIXELS = 12
MAX_COLOURS = 12
"""Drawn colours: a few each for lines, writing and the background of a databar."""
MIN_IN_FEW_COLOURS = 0.6
"""Part of the coloured pixels that have one of so many colours; antialiasing mixes the others."""


@dataclass(frozen=True, kw_only=True)
class Limits:
    """How colour looks after storing it exactly, or with loss."""

    min_chroma: int
    """Difference between the largest and the smallest channel of a drawn colour, of 255."""
    max_grey_chroma: int
    """The same of grey: JPEG stores colour at half the resolution, which bleeds from lines."""
    min_grey: float
    """Part of the other pixels that is grey: antialiased or bleeding lines leave a few."""
    max_part: float
    """A databar may be coloured throughout."""
    step: int
    """Levels of a channel that count as one."""


EXACT = Limits(min_chroma=32, max_grey_chroma=0, min_grey=0.98, max_part=0.4, step=1)
LOSSY = Limits(min_chroma=96, max_grey_chroma=12, min_grey=0.85, max_part=0.05, step=32)
"""Only bright thin lines are told after JPEG: a tint has as many shades as its artefacts."""


def drawn_colour(pixels: Array, *, lossy: bool) -> Bool | None:
    """Where colour is drawn into a grey image (H, W, 3 or more) of 8 bits; None if nowhere."""
    if pixels.ndim != 3 or pixels.shape[2] < 3 or pixels.dtype != np.uint8:
        return None
    limits = LOSSY if lossy else EXACT
    rgb = pixels[..., :3]
    chroma = rgb.max(axis=2) - rgb.min(axis=2)
    coloured = np.asarray(chroma >= limits.min_chroma)
    count = int(coloured.sum())
    if not MIN_PIXELS <= count <= limits.max_part * coloured.size:
        return None
    if (chroma[~coloured] <= limits.max_grey_chroma).mean() < limits.min_grey:
        return None
    levels = (rgb[coloured].astype(np.int64) + limits.step // 2) // limits.step
    _, pixels_of_colour = np.unique(levels @ (1 << np.array([18, 9, 0])), return_counts=True)
    few = np.sort(pixels_of_colour)[::-1][:MAX_COLOURS]
    return coloured if few.sum() >= MIN_IN_FEW_COLOURS * count else None
