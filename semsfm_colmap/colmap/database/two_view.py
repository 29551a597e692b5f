"""Verified pairs of images as the database stores them."""

from __future__ import annotations

from collections.abc import Sequence

from semsfm_colmap.colmap.database.work import ImagePair
from semsfm_colmap.types import AffineTwoViewGeometry, Array, Float


def stored_geometry(
    geometry: AffineTwoViewGeometry, image_ids: Sequence[int]
) -> tuple[ImagePair, tuple[Float | None, Array]]:
    """The pair of image ids, the smaller first as COLMAP keeps it, with F and inlier matches.

    ``x2^T F x1 = 0`` becomes ``x1^T F^T x2 = 0`` where the ids run against the image numbers.
    """
    i, j = geometry.image_pair
    a, b = image_ids[i], image_ids[j]
    F, rows = geometry.F, geometry.keypoints[geometry.inlier]
    if a < b:
        return (a, b), (F, rows)
    return (b, a), (None if F is None else F.T, rows[:, ::-1])
