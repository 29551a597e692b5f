"""Matches of the pairs and their affine epipolar geometry, as the page's script reads them.

Two ways to it. The matches of a pair give the hyperplane ``a x1 + b y1 + c x2 + d y2 + e = 0``,
fitted to those that were verified. The cameras of the model give it for any two registered images,
which the script works out: the points that one image shows at x1 lie on a ray, and the other image
shows the ray as a line through ``P2 pinv(P1) (x1 - t1) + t2`` along ``P2 d1``, d1 the first one's
viewing direction.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from semsfm_colmap.geometry.epipolar import (
    estimate_affine_fundamental,
    hyperplane_from_fundamental,
)
from semsfm_colmap.records import MATCH_STEPS
from semsfm_colmap.report.images.evidence import ImageEvidence, PairEvidence
from semsfm_colmap.report.images.marks import SizePx, even_by_fate
from semsfm_colmap.report.images.packed import base64_of, packed_places
from semsfm_colmap.types import Float, OrthographicCameras

MIN_MATCHES = 8
"""Verified matches, for a geometry that is worth drawing."""
SIGNIFICANT = 12
"""Digits: the constant is of the order of the image, and a tenth of a pixel should not be lost."""


def rounded(values: Float) -> list[float]:
    """Numbers for JSON with as many digits as matter."""
    return [float(f"{v:.{SIGNIFICANT}g}") for v in np.ravel(values)]


def hyperplane_of_matches(xy1: Float, xy2: Float) -> Float | None:
    """(5,) ``(a, b, c, d, e)`` fitted to matches, ``a x1 + b y1 + c x2 + d y2 + e = 0``.

    The first four have unit norm; None for too few matches.
    """
    if len(xy1) < MIN_MATCHES:
        return None
    return np.append(*hyperplane_from_fundamental(estimate_affine_fundamental(xy1, xy2)))


def packed_cameras(cameras: OrthographicCameras, image_idx: int) -> list[float]:
    """Eleven numbers: the linear part of the projection (2 x 3), translation, viewing direction."""
    P, t = cameras.projection[image_idx], cameras.translation_px[image_idx]
    return rounded(np.concatenate([P.ravel(), t, cameras.viewing_direction[image_idx]]))


def packed_pair(
    pair: PairEvidence,
    images: Mapping[str, ImageEvidence],
    frame_of: Mapping[str, int],
    sizes_px: Sequence[SizePx],
    max_num: int,
) -> dict[str, Any]:
    """The matches of a pair, each with the filter that dropped it, and the geometry they agree on.

    The frame with the lower number comes first.
    """
    first, second = (0, 1) if frame_of[pair.names[0]] < frame_of[pair.names[1]] else (1, 0)
    names = pair.names[first], pair.names[second]
    xy = [
        np.asarray(images[names[k]].keypoints[pair.matches[:, side], :2], dtype=np.float64)
        for k, side in enumerate((first, second))
    ]
    keep = pair.verified
    geometry = hyperplane_of_matches(xy[0][keep], xy[1][keep])
    rows = even_by_fate(pair.step, max_num)
    frames = [frame_of[name] for name in names]
    return {
        "frames": frames,
        "xy": [packed_places(p[rows], sizes_px[f]) for p, f in zip(xy, frames, strict=True)],
        "step": base64_of(pair.step[rows], "u1"),
        "num": len(rows),
        "counts": np.bincount(pair.step, minlength=len(MATCH_STEPS)).tolist(),
        "known": pair.steps_known,
        "n": None if geometry is None else rounded(geometry),
    }
