"""SIFT by OpenCV, with keypoints and descriptors as COLMAP has them.

The same detector as COLMAP's (Lowe, IJCV 60, 2004: extrema of differences of Gaussians, three
levels an octave) at a third of its time, and the same answer whatever the number of threads.
Descriptors are turned into RootSIFT (Arandjelovic and Zisserman, CVPR 2012), as COLMAP's are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from semsfm_colmap.features.frames import PIXEL_CENTRE
from semsfm_colmap.features.regions import Regions
from semsfm_colmap.features.selection import spread_evenly
from semsfm_colmap.types import Array, Bool, Features, Float

NUM_LEVELS = 3
"""Levels of an octave whose extrema are keypoints."""
DETECTOR_ID = 9
MAX_DOUBLED_PX = 3200
"""A larger image is not doubled: its finest keypoints are noise, and the memory is that of ten."""
GRID_CELLS = 16


@dataclass(frozen=True, kw_only=True, eq=False)
class Detected:
    """What SIFT finds in an image, to be described turned or upright."""

    found: Float
    """(N, 6) place, diameter, angle in degrees, response, octave, as OpenCV counts them; a place
    once for each of its dominant gradients"""
    pixels: Array
    """what OpenCV looks at: the image, or a smaller one"""
    shape: tuple[int, int]
    """of the image as given"""

    @property
    def ratio(self) -> Float:
        """(2,) px of the image a pixel looked at."""
        return np.array(self.shape[::-1]) / self.pixels.shape[::-1]


def opencv_sift(
    image: Array,
    mask: Bool | None = None,
    *,
    max_num_features: int = 8192,
    first_octave: int = -1,
    peak_threshold: float = 0.02 / 3,
    edge_threshold: float = 10.0,
    upright: bool = False,
) -> Features:
    """Keypoints of an image with RootSIFT descriptors (K, 128) float32 of length 1.

    Parameters
    ----------
    image : (H, W) uint8
    mask : (H, W) True where usable
    max_num_features : the strongest of each part of the image; 0 keeps all
    first_octave : -1 doubles the image first, 1 halves it
    peak_threshold : least contrast of a keypoint, as COLMAP counts it
    edge_threshold : ratio of curvatures above which a keypoint is an edge
    upright : keypoints keep the image's orientation

    """
    detected = detect_sift(
        image,
        mask,
        first_octave=first_octave,
        peak_threshold=peak_threshold,
        edge_threshold=edge_threshold,
    )
    return describe_sift(detected, max_num_features=max_num_features, upright=upright)


def detect_sift(
    image: Array,
    mask: Bool | None = None,
    *,
    first_octave: int = -1,
    peak_threshold: float = 0.02 / 3,
    edge_threshold: float = 10.0,
) -> Detected:
    """Places of an image (H, W) uint8 with their scales and gradients, see `opencv_sift`."""
    import cv2

    if max(image.shape) > MAX_DOUBLED_PX:
        first_octave = max(first_octave, 0)
    # OpenCV doubles whatever it is given
    factor = 2.0 ** -(first_octave + 1)
    pixels = _resized(image, factor)
    sift = cv2.SIFT.create(
        nOctaveLayers=NUM_LEVELS,
        contrastThreshold=NUM_LEVELS * peak_threshold,
        edgeThreshold=edge_threshold,
        enable_precise_upscale=True,
    )
    usable = None if mask is None else _resized(mask.astype(np.uint8), factor)
    found = np.array(
        [(*k.pt, k.size, k.angle, k.response, k.octave) for k in sift.detect(pixels, usable)]
    ).reshape(-1, 6)
    return Detected(found=found, pixels=pixels, shape=(image.shape[0], image.shape[1]))


def describe_sift(
    detected: Detected, *, max_num_features: int = 8192, upright: bool = False
) -> Features:
    """The strongest keypoints of each part of an image with their descriptors, see `opencv_sift`.

    OpenCV describes with the numbers that its keypoints carry, whatever it was made with.
    """
    import cv2

    found, ratio = detected.found, detected.ratio
    if upright:
        # a place with several dominant gradients was found once for each
        found = np.unique(found * (1.0, 1.0, 1.0, 0.0, 1.0, 1.0), axis=0)
    found = found[_strongest(found, ratio, detected.shape, max_num_features)]
    points = [
        cv2.KeyPoint(x, y, size, angle, response, int(octave))
        for x, y, size, angle, response, octave in found.tolist()
    ]
    sift = cv2.SIFT.create(nOctaveLayers=NUM_LEVELS, enable_precise_upscale=True)
    described, values = sift.compute(detected.pixels, points) if points else ((), None)
    if values is None:
        values = np.zeros((0, 128), dtype=np.float32)
    if len(described) != len(found):
        raise AssertionError(f"{len(described)} of {len(found)} keypoints are described")
    angle = np.deg2rad(found[:, 3])
    scale = _scales(found, ratio)
    cos, sin = np.cos(angle), np.sin(angle)
    rotation = np.stack([np.stack([cos, -sin], -1), np.stack([sin, cos], -1)], -2)
    return Features(
        xy=_places(found, ratio) + PIXEL_CENTRE,
        scale_px=scale,
        angle_rad=angle,
        affine_shape=scale[:, None, None] * rotation,
        response=found[:, 4],
        detector_id=np.full(len(found), DETECTOR_ID),
        descriptors=_root(values),
    )


def _resized(image: Array, factor: float) -> Array:
    import cv2

    if factor == 1.0:
        return np.ascontiguousarray(image)
    method = cv2.INTER_AREA if factor < 1.0 else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(image, None, fx=factor, fy=factor, interpolation=method))


def _places(found: Float, ratio: Float) -> Float:
    """Places (K, 2) in the image as given, its first pixel's centre at zero."""
    return np.asarray((found[:, :2] + 0.5) * ratio - 0.5)


def _scales(found: Float, ratio: Float) -> Float:
    """OpenCV gives the diameter."""
    return np.asarray(0.5 * found[:, 2] * float(np.sqrt(np.prod(ratio))))


def _strongest(found: Float, ratio: Float, shape: tuple[int, ...], max_num: int) -> Array:
    regions = Regions(
        xy=_places(found, ratio),
        scale_px=_scales(found, ratio),
        shape=np.broadcast_to(np.eye(2), (len(found), 2, 2)),
        response=found[:, 4],
        detector_id=np.zeros(len(found), dtype=np.int64),
    )
    return spread_evenly(regions, max_num, (shape[0], shape[1]), GRID_CELLS)


def _root(values: Array) -> Array:
    """Square roots of descriptors that add up to 1."""
    total = np.maximum(values.sum(axis=1, keepdims=True), 1e-12)
    return np.sqrt(values / total)
