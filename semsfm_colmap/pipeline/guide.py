"""The images of a series for the guided pass, read when they are needed."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path

from semsfm_colmap.io.grey import read_grey, read_mask
from semsfm_colmap.mapping.context import Guide
from semsfm_colmap.matching.guided.options import GuidedOptions
from semsfm_colmap.types import Array, Float, ParallelMap

IMAGES_IN_MEMORY = 64


def guide_from_folders(
    image_path: Path,
    mask_path: Path | None,
    keypoints: Mapping[str, Float],
    options: GuidedOptions,
    parallel_map: ParallelMap = map,
) -> Guide:
    """Prepared images, and masks of COLMAP's convention.

    Parameters
    ----------
    keypoints : (K, 2) px of each image, in the order of the series
    parallel_map : over the images, in processes that see both folders

    """
    names = tuple(keypoints)
    return Guide(
        read_image=ImageReader(image_path, names),
        read_mask=lambda i: read_mask(mask_path, names[i]),
        read_keypoints=lambda i: keypoints[names[i]],
        options=options,
        parallel_map=parallel_map,
    )


class ImageReader:
    """The pixels of an image by its number, those used last kept; pickled without them."""

    def __init__(self, image_path: Path, names: tuple[str, ...]) -> None:
        self.given = image_path, names
        self.read = lru_cache(maxsize=IMAGES_IN_MEMORY)(lambda i: read_grey(image_path / names[i]))

    def __reduce__(self) -> tuple[object, ...]:
        return ImageReader, self.given

    def __call__(self, i: int) -> Array:
        """The pixels (H, W) of image i."""
        return self.read(i)
