"""The images of a series for the guided pass, read when they are needed."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path

from semsfm_colmap.io.grey import read_grey, read_mask
from semsfm_colmap.mapping.context import Guide
from semsfm_colmap.matching.guided.options import GuidedOptions
from semsfm_colmap.types import Array, Float

IMAGES_IN_MEMORY = 64


def guide_from_folders(
    image_path: Path,
    mask_path: Path | None,
    keypoints: Mapping[str, Float],
    options: GuidedOptions,
) -> Guide:
    """Prepared images, and masks of COLMAP's convention.

    Parameters
    ----------
    keypoints : (K, 2) px of each image, in the order of the series

    """
    names = list(keypoints)

    @lru_cache(maxsize=IMAGES_IN_MEMORY)
    def read_image(i: int) -> Array:
        return read_grey(image_path / names[i])

    return Guide(
        read_image=read_image,
        read_mask=lambda i: read_mask(mask_path, names[i]),
        read_keypoints=lambda i: keypoints[names[i]],
        options=options,
    )
