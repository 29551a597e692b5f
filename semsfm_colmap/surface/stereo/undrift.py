"""Images as they would be without the scan drift that the mapping took out of the observations.

While a frame is scanned the specimen creeps, so that what a frame without drift shows at q lies at

    p = q + (a, b) (v_q - H / 2) / H,

(a, b) px over the height H of the frame (`refinement/scan_drift.py`). Cameras and points are those
of frames without drift; an image that is sampled at p wherever they say q agrees with them. The map
is affine, so that one resampling in front of everything else is all that it takes.
"""

from __future__ import annotations

import numpy as np

from semsfm_colmap.types import Array, Float

NEGLIGIBLE_PX = 0.02
"""A smaller drift is left in: resampling would blur more than it mends."""


def without_drift(grey: Array, drift_px: tuple[float, float], *, nearest: bool = False) -> Array:
    """An image (H, W) sampled where its drift has taken what belongs to each pixel.

    Parameters
    ----------
    grey : of a floating type, or uint8
    drift_px : displacement in x and y of the last row against the first
    nearest : take the nearest pixel, for masks, not Lanczos' kernel over 8 x 8

    Examples
    --------
    Without a drift that counts the image itself comes back:

    >>> grey = np.arange(12.0).reshape(3, 4)
    >>> without_drift(grey, (0.01, 0.0)) is grey
    True

    """
    if max(abs(drift_px[0]), abs(drift_px[1])) < NEGLIGIBLE_PX:
        return grey
    import cv2

    height, width = grey.shape
    a, b = drift_px[0] / height, drift_px[1] / height
    from_middle = 0.5 - 0.5 * height  # of the first row, by its centre
    there = np.array([[1.0, a, a * from_middle], [0.0, 1.0 + b, b * from_middle]])
    return np.asarray(
        cv2.warpAffine(
            grey,
            there,
            (width, height),
            flags=(cv2.INTER_NEAREST if nearest else cv2.INTER_LANCZOS4) | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REPLICATE,
        )
    )


def drifted(q: Float, drift_px: tuple[float, float], height: int) -> Float:
    """The module's p of each q: where an image with the drift shows what belongs there, (N, 2) px.

    Examples
    --------
    >>> drifted(np.array([[10.0, 0.0], [10.0, 50.0], [10.0, 100.0]]), (0.4, -0.2), 100)
    array([[ 9.8,  0.1],
           [10. , 50. ],
           [10.2, 99.9]])

    """
    from_middle = (q[:, 1:] - 0.5 * height) / height
    return np.asarray(q + from_middle * np.asarray(drift_px))


def drift_of(drift_px: Array | None, image_idx: int) -> tuple[float, float]:
    """The drift of one image of (M, 2), none where there is none."""
    if drift_px is None:
        return 0.0, 0.0
    return float(drift_px[image_idx, 0]), float(drift_px[image_idx, 1])
