"""The same view twice: copies in other formats are left out, repeated frames are said.

A microscope's TIFF and its export as PNG or JPEG are one view. Counted twice, error bars would
shrink by the root of two for no information. Three cases:

- the same pixels, under any names;
- pixels that differ by less than their noise: the file was compressed with loss, or its brightness
  changed; copies share the noise;
- the same view with noise of its own, a frame that was taken again: it is kept and said.

Of copies the one is kept whose header says most. Frames are compared reduced, after a shift and a
change of brightness, which charging makes another across the frame; a turn of the specimen leaves
differences with structure where noise has none, and smoothing takes noise away and leaves them.
Of two frames of one width, one of which has lost its databar or has one that was not found, the
rows that both have are compared.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import PurePosixPath

import numpy as np

from semsfm_colmap.geometry.pixel_noise import noise_level
from semsfm_colmap.ingest.files.raster import RawImage
from semsfm_colmap.ingest.frame.databar import to_levels
from semsfm_colmap.ingest.frame.source import SourceImage
from semsfm_colmap.types import Array, Float

SIDE_PX = 256
"""Longer side of the reduced frames that are compared."""
FIRST_SIDE_PX = 24
"""Side of those that choose which pairs to compare."""
FIRST_CORRELATION = 0.9
MAX_CANDIDATES = 4
"""A frame is compared with so many others: those most like it."""
MAX_DIFFERENCE = 0.7
"""Difference of one view from itself, relative to the contrast: noise is less than the image."""
MAX_STRUCTURE = 0.22
"""Correlation of neighbouring pixels of a difference: noise has 0, the interpolation of a shift
makes 0.1 of it, and a specimen turned by a degree 0.5 and more."""
SMOOTHING_PX = 2.0
MAX_SMOOTH_NOISE, MAX_SMOOTH_CONTRAST = 2.5, 0.03
"""A smoothed difference that is more than so many times its noise, and than that share of the
contrast, is of another view: a grain turned by 1.7 degrees leaves 22 times and 4 %; taken again
with a shift, 1 px of drift within the frame and 15 % of uneven brightness 1.6 times and 1 %."""
MAX_SHIFT = 0.1
"""Shift of a view taken again, relative to the longer side."""
ALIGN_STEPS = 20
MIN_COMMON_ROWS = 0.7
"""Least share of the rows of a frame that another must have: databars take less than the rest."""
ROUNDING = 0.5
"""Grey levels of a difference in which no structure is looked for."""
SHARED_NOISE = 0.6
"""Difference of copies relative to that of two frames with noise of their own."""


@dataclass(frozen=True, kw_only=True, eq=False)
class View:
    """A frame as far as it is compared with others: its pixels' hash, and they reduced."""

    digest: bytes
    small: Array
    noise: float
    """Standard deviation of the noise in `small`, grey levels."""


def view_of(image: SourceImage, raw: RawImage) -> View:
    """The image part of a frame, reduced."""
    import cv2

    grey = to_levels(raw.pixels)[: image.databar_row]
    scale = min(1.0, SIDE_PX / max(grey.shape))
    size = (max(8, round(grey.shape[1] * scale)), max(8, round(grey.shape[0] * scale)))
    small = np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA))
    return View(digest=_digest(raw), small=small, noise=noise_level(small))


def leave_out_copies(
    images: Sequence[SourceImage], views: Sequence[View]
) -> tuple[list[int], list[str], list[str]]:
    """Numbers of the images to keep, a sentence an image left out, and one about repeated views."""
    group = list(range(len(images)))
    repeated: list[tuple[int, int]] = []
    for i, j in _candidates(views):
        same, copied = _compare(images[i], views[i], images[j], views[j])
        if copied:
            old, new = group[j], group[i]
            group = [new if g == old else g for g in group]
        elif same:
            repeated.append((i, j))
    best: dict[int, int] = {}
    for k, g in enumerate(group):
        if g not in best or _worth(images[k]) > _worth(images[best[g]]):
            best[g] = k
    keep = sorted(best.values())
    problems = []
    for k, g in enumerate(group):
        if best[g] == k:
            continue
        exact = views[k].digest == views[best[g]].digest
        of = "the pixels are those of" if exact else "the same view, noise included, as"
        problems.append(f"{images[k].name}: {of} {images[best[g]].name}. Left out.")
    kept = set(keep)
    said = [
        f"{images[j].name} shows the view of {images[i].name} again: a frame more of the same view "
        "averages noise out, not what both are wrong by."
        for i, j in repeated
        if i in kept and j in kept
    ]
    return keep, problems, said


def _candidates(views: Sequence[View]) -> list[tuple[int, int]]:
    """Pairs that may show one view, each once, copies of the same pixels first."""
    import cv2

    if len(views) < 2:
        return []
    side = (FIRST_SIDE_PX, FIRST_SIDE_PX)
    least: dict[int, int] = {}
    for view in views:
        rows, width = view.small.shape
        least[width] = min(rows, least.get(width, rows))
    tiny = []
    for view in views:
        rows, width = view.small.shape
        common = least[width] if least[width] >= MIN_COMMON_ROWS * rows else rows
        tiny.append(cv2.resize(view.small[:common], side, interpolation=cv2.INTER_AREA).ravel())
    vectors = np.array(tiny, dtype=np.float32)
    vectors -= vectors.mean(axis=1, keepdims=True)
    vectors /= np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-6)
    alike = vectors @ vectors.T
    np.fill_diagonal(alike, -1.0)
    pairs = set()
    first: dict[bytes, int] = {}
    for i, view in enumerate(views):
        if first.setdefault(view.digest, i) != i:
            pairs.add((first[view.digest], i))
        for j in np.argsort(-alike[i], kind="stable")[:MAX_CANDIDATES]:
            if alike[i, j] >= FIRST_CORRELATION:
                pairs.add((min(i, int(j)), max(i, int(j))))
    return sorted(pairs)


def _compare(one: SourceImage, a: View, other: SourceImage, b: View) -> tuple[bool, bool]:
    """Whether two frames show one view, and whether one of them is a copy of the other."""
    if a.digest == b.digest:
        return True, True
    rows = sorted((a.small.shape[0], b.small.shape[0]))
    if a.small.shape[1] != b.small.shape[1] or rows[0] < MIN_COMMON_ROWS * rows[1]:
        return False, False
    difference, contrast = _difference(a.small[: rows[0]], b.small[: rows[0]])
    size = float(difference.std())
    if contrast == 0 or size > MAX_DIFFERENCE * contrast:
        return False, False
    exported = one.header.format != other.header.format and _stem(one) == _stem(other)
    own_noise = float(np.hypot(a.noise, b.noise))
    shared = size < SHARED_NOISE * own_noise
    turned = _structure(difference) > MAX_STRUCTURE or _outlasts(difference, own_noise, contrast)
    if turned and not exported and size > ROUNDING:
        return False, False
    return True, exported or shared


def _difference(first: Array, second: Array) -> tuple[Float, float]:
    """What remains of the second frame after the first, shifted and of other brightness."""
    import cv2

    a, b = first.astype(np.float32), second.astype(np.float32)
    shift = _shift(a, b)
    if np.abs(shift).max() > 0.1:
        move = np.array([[1, 0, shift[0]], [0, 1, shift[1]]], dtype=np.float32)
        a = np.asarray(cv2.warpAffine(a, move, a.shape[::-1], flags=cv2.INTER_CUBIC))
    border = 1 + int(np.ceil(np.abs(shift).max())) if np.abs(shift).max() > 0.1 else 0
    inside = np.s_[border : a.shape[0] - border, border : a.shape[1] - border]
    a, b = a[inside].astype(np.float64), b[inside].astype(np.float64)
    y, x = (np.linspace(-1.0, 1.0, n) for n in a.shape)
    flat = np.ones_like(a)
    field = np.stack([flat, x * flat, y[:, None] * flat])
    basis = np.concatenate([field, a * field]).reshape(6, -1)
    weights = np.linalg.lstsq(basis @ basis.T, basis @ b.ravel(), rcond=None)[0]
    return b - (weights @ basis).reshape(b.shape), float(b.std())


def _shift(a: Array, b: Array) -> tuple[float, float]:
    """How far the second frame lies from the first, px; nothing where that cannot be said."""
    import cv2

    window = cv2.createHanningWindow(a.shape[::-1], cv2.CV_32F)
    a, b = a.copy(), b.copy()  # both routines below work in place
    (x, y), _ = cv2.phaseCorrelate(a.copy(), b.copy(), window)
    move = np.array([[1, 0, x], [0, 1, y]], dtype=np.float32)
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, ALIGN_STEPS, 1e-3)
    try:
        _, move = cv2.findTransformECC(a, b, move, cv2.MOTION_TRANSLATION, stop, None, 3)
    except cv2.error:  # it found no better one, or nothing overlaps
        return 0.0, 0.0
    x, y = float(move[0, 2]), float(move[1, 2])
    usual = max(abs(x), abs(y)) <= MAX_SHIFT * max(a.shape)
    return (x, y) if usual else (0.0, 0.0)


def _structure(difference: Float) -> float:
    """Correlation of a difference with itself a pixel on, in the mean of both directions."""
    power = max(float((difference**2).mean()), 1e-12)
    right = float((difference[:, 1:] * difference[:, :-1]).mean())
    down = float((difference[1:] * difference[:-1]).mean())
    return (right + down) / (2 * power)


def _outlasts(difference: Float, noise: float, contrast: float) -> bool:
    """Whether smoothing leaves more of a difference than of noise."""
    import cv2

    left = float(cv2.GaussianBlur(difference, (0, 0), SMOOTHING_PX).std())
    of_noise = noise / (2.0 * np.sqrt(np.pi) * SMOOTHING_PX)
    return left > MAX_SMOOTH_NOISE * of_noise and left > MAX_SMOOTH_CONTRAST * contrast


def _worth(image: SourceImage) -> tuple[int, int, int, int]:
    """How much a copy says: its header, then its pixels."""
    metadata = image.reading.metadata
    recorded = [f.name for f in fields(metadata) if getattr(metadata, f.name) not in (None, {})]
    vital = ("pixel_size_um", "tilt_rad", "stage_rotation_rad")
    return (
        sum(name in recorded for name in vital),
        len(recorded),
        int(not image.header.lossy),
        image.header.bits * image.size[0],
    )


def _stem(image: SourceImage) -> str:
    return PurePosixPath(image.name).stem.lower()


def _digest(raw: RawImage) -> bytes:
    pixels = np.ascontiguousarray(raw.pixels)
    shape = repr((pixels.shape, pixels.dtype.str)).encode()
    return hashlib.blake2b(pixels.data, digest_size=16, key=shape[:64]).digest()
