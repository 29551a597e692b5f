"""The specimen in front of an empty background, from one image.

Empty background in an electron micrograph is a field of one mean with nothing but detector noise
in it. It is taken as the part that is connected to the image border and whose local mean and local
spread stay near those of the border's flattest part. Everything else is foreground, grown by a
margin so that no edge is cut.

A mask must not take a specimen away. Texture is what counts for matching, so the share of gradient
energy above the noise that the mask keeps is measured, and a mask that keeps too little of it, or
hardly covers anything, is not used.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from semsfm_colmap.types import Array, Bool, Float

WORK_SIDE_PX = 512
"""Masks are computed on images reduced to this: outlines matter, not single pixels."""
BORDER_PART = 0.04
"""Width of the border strip, relative to the longer side, that the background is learnt from."""
MAX_SPREAD = 2.0
"""Local spread of background pixels relative to that of the flattest border."""
MAX_LEVEL = 4.0
"""Deviation of the local mean of background pixels, in spreads of the flattest border."""
MIN_BACKGROUND = 0.08
"""A smaller background is not worth a mask, and may be a dark corner of the specimen."""
MIN_FOREGROUND = 0.01
MIN_TEXTURE_KEPT = 0.95
"""Part of the gradient energy above the noise that must lie inside the mask."""
MARGIN_PART = 0.015
"""How far the foreground is grown, relative to the longer side."""
MIN_PIECE = 2e-3
"""Smaller foreground pieces, relative to the image, are specks on the background."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Foreground:
    """A mask, True where the specimen is; None with the reason otherwise."""

    mask: Bool | None
    reason: str = ""


def find_foreground(pixels: Array) -> Foreground:
    """Separate the specimen from an empty background in 8-bit grey pixels (H, W)."""
    import cv2

    height, width = pixels.shape
    scale = min(1.0, WORK_SIDE_PX / max(height, width))
    size = (max(8, round(width * scale)), max(8, round(height * scale)))
    small = cv2.resize(pixels, size, interpolation=cv2.INTER_AREA).astype(np.float32)
    level = cv2.GaussianBlur(small, (0, 0), 2.0)
    smooth = cv2.GaussianBlur(small, (0, 0), 0.8)
    spread = np.sqrt(
        np.maximum(cv2.blur(smooth * smooth, (9, 9)) - cv2.blur(smooth, (9, 9)) ** 2, 0)
    )
    background = _connected_background(level, spread)
    foreground = _without_specks(~background)
    margin = max(2, round(MARGIN_PART * max(size)))
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * margin + 1, 2 * margin + 1))
    foreground = cv2.dilate(foreground.astype(np.uint8), kernel) > 0
    part = float(1 - foreground.mean())
    kept = _share_of_texture(smooth, foreground)
    if part < MIN_BACKGROUND:
        return Foreground(mask=None, reason="there is no empty background")
    if 1 - part < MIN_FOREGROUND:
        return Foreground(mask=None, reason="no specimen stands out")
    if kept < MIN_TEXTURE_KEPT:
        return Foreground(
            mask=None,
            reason=f"a mask would take away {1 - kept:.0%} of the texture",
        )
    full = cv2.resize(foreground.astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST)
    return Foreground(mask=full > 0)


def _connected_background(level: Float, spread: Float) -> Bool:
    """Flat pixels of the border's level that are connected to the border."""
    import cv2

    strip = max(3, round(BORDER_PART * max(level.shape)))
    border = np.ones(level.shape, dtype=bool)
    border[strip:-strip, strip:-strip] = False
    flat_spread = max(float(np.percentile(spread[border], 20)), 0.3)
    flat = border & (spread <= 1.5 * flat_spread)
    centre = float(np.median(level[flat])) if flat.any() else float(np.median(level[border]))
    width = max(float(np.percentile(np.abs(level[flat] - centre), 80)) if flat.any() else 0.0, 1.0)
    candidate = (spread <= MAX_SPREAD * flat_spread) & (
        np.abs(level - centre) <= MAX_LEVEL * width + flat_spread
    )
    _, labels = cv2.connectedComponents(candidate.astype(np.uint8), connectivity=4)
    touching = np.unique(labels[border & candidate])
    touching = touching[touching > 0]
    return np.asarray(np.isin(labels, touching) & candidate)


def _without_specks(foreground: Bool) -> Bool:
    import cv2

    count, labels, stats, _ = cv2.connectedComponentsWithStats(
        foreground.astype(np.uint8), connectivity=8
    )
    keep = np.zeros(count, dtype=bool)
    keep[1:] = stats[1:, cv2.CC_STAT_AREA] >= MIN_PIECE * foreground.size
    return np.asarray(keep[labels])


def texture_kept(pixels: Array, mask: Bool) -> float:
    """Share of the texture of 8-bit pixels (H, W) that lies where the mask is True."""
    import cv2

    scale = min(1.0, WORK_SIDE_PX / max(pixels.shape))
    size = (max(8, round(pixels.shape[1] * scale)), max(8, round(pixels.shape[0] * scale)))
    small = cv2.resize(pixels, size, interpolation=cv2.INTER_AREA).astype(np.float32)
    inside = cv2.resize(mask.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
    return _share_of_texture(np.asarray(cv2.GaussianBlur(small, (0, 0), 0.8)), inside)


def _share_of_texture(smooth: Float, mask: Bool) -> float:
    """Share of the squared gradient above the noise floor that lies inside the mask."""
    dy, dx = np.gradient(smooth)
    energy = dx * dx + dy * dy
    floor = 4.0 * float(np.percentile(energy, 30))
    excess = np.maximum(energy - floor, 0.0)
    total = float(excess.sum())
    return float(excess[mask].sum()) / total if total > 0 else 1.0
