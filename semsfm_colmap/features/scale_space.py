"""Gaussian scale space in octaves, halved in size from one to the next.

Level s of octave o has the deviation ``sigma = BASE_SIGMA step 2^(s / LEVELS)`` px of the image,
where ``step = 2^o`` is the distance of its pixels. Regions are looked for at s = 0 .. LEVELS - 1;
the levels on either side serve the search over scale, and s - 2, at sigma / sqrt(2), the
derivatives of the Harris detector (differentiation at 0.7 times the integration scale:
Mikolajczyk and Schmid, IJCV 60, 2004). Half of the levels of an octave come for free from the one
before.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from semsfm_colmap.types import Array, Float, Int

LEVELS = 4
"""Scales per octave, so that two levels are a factor sqrt(2)."""
BELOW = 2
"""Levels before s = 0."""
BASE_SIGMA = 1.2
"""Deviation of s = 0 in px of its octave: small regions are found without doubling the image, and
derivatives by differences of pixels are still good."""
CAMERA_SIGMA = 0.5
"""Blur the image is taken to have [Lowe 2004]."""
MIN_SIDE = 12
"""Octaves smaller than this are not built."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Octave:
    """Levels of one size; ``x_image = step x + offset`` in pixel indices."""

    step: float
    offset: float
    levels: tuple[Array, ...]
    """BELOW + LEVELS + 1 images (h, w) float32"""

    def level(self, s: int) -> Array:
        """The image at level s, from -BELOW to LEVELS."""
        return self.levels[s + BELOW]

    def sigma(self, s: float) -> float:
        """Deviation of level s in px of the image."""
        return BASE_SIGMA * self.step * 2.0 ** (s / LEVELS)


@dataclass(frozen=True, kw_only=True, eq=False)
class ScaleSpace:
    """All octaves, fine to coarse."""

    octaves: tuple[Octave, ...]
    shape: tuple[int, int]

    def nearest_level(self, sigma_px: Float) -> tuple[Int, Int]:
        """Octave and level (K,) whose deviation is nearest; the coarsest octave that has it."""
        first = self.octaves[0].sigma(0.0)
        position = np.rint(LEVELS * np.log2(np.maximum(sigma_px, 1e-9) / first)).astype(np.int64)
        octave = np.clip(position // LEVELS, 0, len(self.octaves) - 1)
        level = np.clip(position - octave * LEVELS, -BELOW, LEVELS)
        return octave, level


def build_scale_space(pixels: Array, *, first_octave: int, max_scale_px: float) -> ScaleSpace:
    """Scale space of an image up to the octave that holds `max_scale_px`.

    Parameters
    ----------
    pixels : (H, W) float32
    first_octave : 0, or -1 for a doubled image

    """
    import cv2

    step, offset, camera = 1.0, 0.0, CAMERA_SIGMA
    image = pixels
    if first_octave < 0:
        step, offset, camera = 0.5, -0.25, 2.0 * CAMERA_SIGMA
        size = (2 * pixels.shape[1], 2 * pixels.shape[0])
        image = cv2.resize(pixels, size, interpolation=cv2.INTER_LINEAR)
    sigmas = [BASE_SIGMA * 2.0 ** (s / LEVELS) for s in range(-BELOW, LEVELS + 1)]
    octaves: list[Octave] = []
    levels: list[Array] = [_blur(image, camera, sigmas[0])]
    while True:
        while len(levels) < len(sigmas):
            k = len(levels)
            levels.append(_blur(levels[-1], sigmas[k - 1], sigmas[k]))
        octaves.append(Octave(step=step, offset=offset, levels=tuple(levels)))
        step *= 2.0
        levels = [np.ascontiguousarray(level[::2, ::2]) for level in levels[LEVELS:]]
        if min(levels[0].shape) < MIN_SIDE or step * BASE_SIGMA > max_scale_px:
            return ScaleSpace(octaves=tuple(octaves), shape=(pixels.shape[0], pixels.shape[1]))


def _blur(image: Array, have: float, want: float) -> Array:
    """Raise the deviation from `have` to `want` px."""
    import cv2

    sigma = math.sqrt(max(want**2 - have**2, 1e-4))
    half = max(1, math.ceil(4.0 * sigma))
    size = (2 * half + 1, 2 * half + 1)
    return np.asarray(cv2.GaussianBlur(image, size, sigma, borderType=cv2.BORDER_REFLECT))
