"""Masks in COLMAP's convention: ``<image name>.png``, 0 = ignore."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from semsfm_colmap.errors import UsageError
from semsfm_colmap.ingest.files.header import UnreadableImageError
from semsfm_colmap.ingest.files.read import read_header, read_pixels
from semsfm_colmap.ingest.frame.source import SourceImage
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.io.layout import MASKS_FOLDER
from semsfm_colmap.types import Bool


def find_masks_folder(image_path: Path, options: IngestOptions) -> Path | None:
    """The folder the masks are in, if any: the option, or ``masks`` in or beside the images."""
    if options.masks == "off":
        return None
    if options.masks_path is not None:
        if not options.masks_path.is_dir():
            raise UsageError(f"{options.masks_path} is not a folder; give the one with the masks.")
        return options.masks_path
    for folder in (image_path / MASKS_FOLDER, image_path.parent / MASKS_FOLDER):
        if folder.is_dir():
            return folder
    return None


def given_mask(
    folder: Path, image: SourceImage, options: IngestOptions
) -> tuple[Bool | None, str | None]:
    """The mask of one image cut like the image, True where usable; or why there is none."""
    for name in (f"{image.name}.png", str(Path(image.name).with_suffix(".png"))):
        path = folder / name
        if path.is_file():
            break
    else:
        return None, None
    try:
        pixels = read_pixels(path, read_header(path, options.max_image_pixels)).pixels
    except UnreadableImageError as error:
        return None, f"its mask {name} is not used: {error}"
    mask = np.asarray(pixels != 0)
    x0, y0, x1, y1 = image.crop
    if mask.shape == image.size[::-1]:
        mask = mask[y0:y1, x0:x1]
    elif mask.shape != (y1 - y0, x1 - x0):
        return None, (
            f"its mask {name} has {mask.shape[1]} x {mask.shape[0]} pixels but the image "
            f"{image.size[0]} x {image.size[1]}: it is not used"
        )
    if not mask.any():
        return None, f"its mask {name} would leave nothing of the image: it is not used"
    return mask, None
