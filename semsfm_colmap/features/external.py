"""What the detectors of another program find, as regions that take part in unions with ours."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from semsfm_colmap.features.frames import PIXEL_CENTRE
from semsfm_colmap.features.regions import Regions, regions_from_frames
from semsfm_colmap.features.registry import EXTERNAL, external_parts
from semsfm_colmap.types import Features

FindFeatures = Callable[[str], Sequence[Features]]
"""The features that the external detector of a name finds in each of some images."""


def external_regions(union: str, num_images: int, find: FindFeatures) -> list[dict[str, Regions]]:
    """What the external detectors in a union find in each image, by detector.

    COLMAP does not say how strong a keypoint is; over its limit it prefers large ones, and so the
    scale stands for the strength.
    """
    result: list[dict[str, Regions]] = [{} for _ in range(num_images)]
    for detector in external_parts(union):
        for regions, features in zip(result, find(detector), strict=True):
            regions[detector] = regions_from_frames(
                features.xy - PIXEL_CENTRE,
                features.affine_shape,
                features.scale_px,
                EXTERNAL[detector],
            )
    return result
