"""Which image pairs to match."""

from __future__ import annotations

from semsfm_colmap.matching.options import MatchingOptions


def select_pairs(num_images: int, options: MatchingOptions) -> list[tuple[int, int]]:
    """Pairs (i < j) of images numbered in acquisition order.

    All pairs when they are few; else each image with its next `overlap` ones, and with
    `loop_closure` modulo the number of images, so that a full turn closes.
    """
    exhaustive = options.pairs == "exhaustive" or (
        options.pairs == "auto" and num_images <= options.max_exhaustive_images
    )
    if exhaustive:
        return [(i, j) for i in range(num_images) for j in range(i + 1, num_images)]
    pairs = set()
    for i in range(num_images):
        for step in range(1, options.overlap + 1):
            j = i + step
            if j >= num_images:
                if not options.loop_closure:
                    continue
                j %= num_images
            if i != j:
                pairs.add((min(i, j), max(i, j)))
    return sorted(pairs)
