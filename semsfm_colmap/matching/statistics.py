"""What became of the matches of each pair, counted from its verification."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from semsfm_colmap.records import PairStatistics
from semsfm_colmap.types import AffineTwoViewGeometry

MIN_STATIC_SHARE = 0.05
"""Share of all matches that stand still from which it is said: of series without a background that
is matched it is 0, of one whose stub stays in place behind the specimen 0.3."""


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


def background_note(pairs: Sequence[PairStatistics]) -> str | None:
    """A sentence where features stand still while others move; None where hardly any do.

    Pairs far apart may have no other matches than those, which then pass for a view that is
    repeated: what was dropped is less than there is, and the angles come out too small.
    """
    still = sum(pair.num_static_rejected for pair in pairs)
    total = sum(pair.num_matches for pair in pairs)
    if total == 0 or still < MIN_STATIC_SHARE * total:
        return None
    where = sum(pair.num_static_rejected > 0 for pair in pairs)
    return (
        f"features stand still while others move: {still / total:.0%} of the matches, in {where} "
        f"of {len(pairs)} pairs: a background or a mount that does not turn with the specimen, "
        "which makes angles too small; leave it out with --masks auto or with masks of your own "
        "(--masks_path)"
    )
