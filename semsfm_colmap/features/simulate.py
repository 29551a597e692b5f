"""View simulation: the image as it would look from the side, detected and described there too.

A patch seen obliquely is its frontal view squeezed in one direction. Squeezing the image on purpose
(Morel and Yu, ASIFT, SIAM J. Imaging Sciences 2, 2009) makes the two look alike where an adaptation
from one image alone fails. Features of all views come back in the coordinates of the image, their
frames as ellipses. The same spot is then described several times: match with an exclusion radius
(`matching.nearest`), so that a feature's twin is not taken for a rival.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from semsfm_colmap.errors import UsageError
from semsfm_colmap.features.frames import PIXEL_CENTRE
from semsfm_colmap.features.options import DescriptorOptions, DetectorOptions
from semsfm_colmap.features.registry import describe, detect, prepare
from semsfm_colmap.types import Array, Bool, Features, Float

ANTIALIAS = 0.8
"""Deviation of the blur before squeezing by t, times sqrt(t^2 - 1) [Morel and Yu 2009]."""
DIRECTION_STEP_DEG = 72.0
"""Directions of a squeeze by t are this far apart, divided by t [Morel and Yu 2009]."""


@dataclass(frozen=True, kw_only=True)
class View:
    """A squeeze by `tilt` >= 1 along a direction, from x toward y."""

    tilt: float = 1.0
    direction_rad: float = 0.0


FRONTAL = View()


def simulated_views(tilts: Sequence[float] = (math.sqrt(2.0),)) -> tuple[View, ...]:
    """The frontal view and, for each tilt, directions all around."""
    views = [FRONTAL]
    for tilt in tilts:
        if not tilt > 1.0:
            raise UsageError(f"{tilt=} but a simulated view squeezes by more than 1")
        num = math.ceil(180.0 * tilt / DIRECTION_STEP_DEG)
        views += [View(tilt=tilt, direction_rad=math.pi * k / num) for k in range(num)]
    return tuple(views)


def squeeze_image(
    image: Array, mask: Bool | None, view: View
) -> tuple[Array, Bool | None, Float, Float]:
    """The image under a view: pixels (float32), mask, and the map ``x' = matrix x + shift``.

    The map is between pixel indices. Places outside the image are masked.
    """
    import cv2

    h, w = image.shape
    pixels = image.astype(np.float32)
    if view.tilt == 1.0:
        return pixels, mask, np.eye(2), np.zeros(2)
    cos, sin = math.cos(view.direction_rad), math.sin(view.direction_rad)
    rotation = np.array([[cos, sin], [-sin, cos]])
    corners = np.array([[0, 0], [w - 1, 0], [0, h - 1], [w - 1, h - 1]]) @ rotation.T
    low = corners.min(axis=0)
    width, height = np.ceil(np.ptp(corners, axis=0)).astype(int) + 1
    turned = cv2.warpAffine(
        pixels,
        np.column_stack([rotation, -low]),
        (int(width), int(height)),
        flags=cv2.INTER_CUBIC,
        borderMode=cv2.BORDER_REPLICATE,
    )
    sigma = ANTIALIAS * math.sqrt(view.tilt**2 - 1.0)
    turned = cv2.GaussianBlur(turned, (0, 0), sigmaX=sigma, sigmaY=1e-3)
    # turned back after the squeeze, so that up stays up
    back = rotation.T @ np.diag([1.0 / view.tilt, 1.0])
    matrix = back @ rotation
    corners = np.array([[0, 0], [w - 1, 0], [0, h - 1], [w - 1, h - 1]]) @ matrix.T
    shift = -corners.min(axis=0)
    width, height = np.ceil(np.ptp(corners, axis=0)).astype(int) + 1
    size = (int(width), int(height))
    squeezed = cv2.warpAffine(
        turned,
        np.column_stack([back, back @ low + shift]),
        size,
        flags=cv2.INTER_CUBIC,
        borderMode=cv2.BORDER_REPLICATE,
    )
    usable = np.full((h, w), 255, np.uint8) if mask is None else mask.astype(np.uint8) * 255
    drawn = cv2.warpAffine(usable, np.column_stack([matrix, shift]), size, flags=cv2.INTER_LINEAR)
    return squeezed, np.asarray(drawn == 255), matrix, shift


def extract_views(
    detector: str,
    descriptor: str,
    image: Array,
    views: Sequence[View],
    *,
    detection: DetectorOptions | None = None,
    description: DescriptorOptions | None = None,
    mask: Bool | None = None,
) -> Features:
    """Features of several simulated views of an image, in the coordinates of the image.

    A limit on their number holds for each view.
    """
    parts = []
    for view in views:
        pixels, usable, matrix, shift = squeeze_image(image, mask, view)
        prepared = prepare(pixels, usable, detection)
        features = describe(
            descriptor, prepared, detect(detector, prepared, detection), description
        )
        back = np.linalg.inv(matrix)
        xy = (features.xy - PIXEL_CENTRE - shift) @ back.T + PIXEL_CENTRE
        shape = back @ features.affine_shape
        scale = features.scale_px * math.sqrt(np.linalg.det(back))
        parts.append(replace(features, xy=xy, affine_shape=shape, scale_px=scale))
    return Features(
        xy=np.concatenate([part.xy for part in parts]),
        scale_px=np.concatenate([part.scale_px for part in parts]),
        angle_rad=np.concatenate([part.angle_rad for part in parts]),
        affine_shape=np.concatenate([part.affine_shape for part in parts]),
        response=np.concatenate([part.response for part in parts]),
        detector_id=np.concatenate([part.detector_id for part in parts]),
        descriptors=np.concatenate([part.descriptors for part in parts]),
    )
