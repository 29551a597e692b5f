"""What became of the matches of each pair, counted from its verification."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from semsfm_colmap.records import PairStatistics
from semsfm_colmap.types import AffineTwoViewGeometry


def pair_statistics(
    geometries: Iterable[AffineTwoViewGeometry], names: Sequence[str]
) -> list[PairStatistics]:
    """Matches of each pair before and after each filter; `names` are those of all images."""
    statistics = []
    for g in geometries:
        i, j = g.image_pair
        num_static = g.rejected_by.get("static", 0)
        after_static = len(g.keypoints) - num_static
        statistics.append(
            PairStatistics(
                image_name_1=names[i],
                image_name_2=names[j],
                num_matches=len(g.keypoints),
                num_static_rejected=num_static,
                num_after_affine_ransac=after_static - g.rejected_by.get("epipolar", 0)
                if g.F is not None
                else 0,
                num_after_distance_filter=int(g.inlier.sum()),
                failure=g.failure,
            )
        )
    return statistics
