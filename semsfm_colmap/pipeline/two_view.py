"""Verified pairs of images as the database stores them and as the report counts them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from semsfm_colmap.types import AffineTwoViewGeometry, Array, Float


def stored_geometry(
    geometry: AffineTwoViewGeometry, image_ids: Sequence[int]
) -> tuple[tuple[int, int], tuple[Float | None, Array]]:
    """The pair of image ids, the smaller first as COLMAP keeps it, with F and inlier matches.

    ``x2^T F x1 = 0`` becomes ``x1^T F^T x2 = 0`` where the ids run against the image numbers.
    """
    i, j = geometry.image_pair
    a, b = image_ids[i], image_ids[j]
    F, rows = geometry.F, geometry.keypoints[geometry.inlier]
    if a < b:
        return (a, b), (F, rows)
    return (b, a), (None if F is None else F.T, rows[:, ::-1])


def pair_statistics(
    geometries: Iterable[AffineTwoViewGeometry], names: Sequence[str]
) -> list[dict[str, Any]]:
    """What became of the matches of each pair: the fields of `records.PairStatistics`."""
    statistics = []
    for g in geometries:
        i, j = g.image_pair
        after_static = len(g.keypoints) - g.rejected_by.get("static", 0)
        statistics.append(
            {
                "image_name_1": names[i],
                "image_name_2": names[j],
                "num_matches": len(g.keypoints),
                "num_static_rejected": g.rejected_by.get("static", 0),
                "num_after_affine_ransac": after_static - g.rejected_by.get("epipolar", 0)
                if g.F is not None
                else 0,
                "num_after_distance_filter": int(g.inlier.sum()),
                "failure": g.failure,
            }
        )
    return statistics
