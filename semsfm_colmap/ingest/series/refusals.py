"""What the stage refuses, in one sentence each."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.ingest.files.listing import IMAGE_SUFFIXES
from semsfm_colmap.ingest.files.mrc import is_stack
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.ingest.series.crops import check_crop
from semsfm_colmap.ingest.series.tilt import parse_axis
from semsfm_colmap.io.layout import IMAGES_FOLDER, MASKS_FOLDER

MIN_IMAGES = 3
"""Two orthographic views leave a one-parameter family of shapes [Koenderink, van Doorn 1991]."""


def check_options(options: IngestOptions) -> None:
    """Refuse values that no series can have."""
    for name, um in (
        ("pixel_size_um", options.pixel_size_um),
        ("scale_bar_um", options.scale_bar_um),
    ):
        if um is not None and not (math.isfinite(um) and um > 0):
            raise UsageError(f"{name} = {um} but expected a positive number of micrometres.")
    if options.crop is not None:
        check_crop(options.crop)
    low, high = options.range_percentiles
    if not 0 <= low < high <= 100:
        raise UsageError(
            f"range_percentiles = {low} {high} but expected two increasing numbers in 0 to 100."
        )
    if options.max_image_pixels < 1:
        raise UsageError(
            f"max_image_pixels = {options.max_image_pixels} but expected a positive number."
        )
    if not 0 < options.flat_field_scale <= 1:
        raise UsageError(
            f"flat_field_scale = {options.flat_field_scale} but expected a number in 0 to 1."
        )
    if not 0 <= options.local_contrast <= 40:
        raise UsageError(
            f"local_contrast = {options.local_contrast} but expected a clip limit in 0 to 40."
        )
    parse_axis(options.tilt_axis)
    sigma = options.tilt_sigma_deg
    if sigma is not None and not (math.isfinite(sigma) and sigma > 0):
        raise UsageError(f"tilt_sigma_deg = {sigma} but expected a positive number.")
    factor = options.degrees_per_um
    if factor is not None and not (math.isfinite(factor) and factor != 0):
        raise UsageError(f"degrees_per_um = {factor} but expected degrees per um of displacement.")
    step = options.tilt_step_deg
    if step is not None and not 0 < abs(step) < 90:
        raise UsageError(f"tilt_step_deg = {step} but expected degrees between two images.")


def check_paths(image_path: Path, project_path: Path) -> None:
    """Refuse to write over the originals."""
    written = [(project_path / name).resolve() for name in (IMAGES_FOLDER, MASKS_FOLDER)]
    if image_path.resolve() in written:
        raise UsageError(
            f"{image_path} is where the prepared images are written; give another output_path, "
            "or move the originals elsewhere."
        )


def no_images_message(image_path: Path, problems: Sequence[str]) -> str:
    """The sentence for a folder without a single image."""
    said = f" ({problems[0]})" if problems else ""
    stack = next((path for path in sorted(image_path.iterdir()) if is_stack(path)), None)
    hint = f" A stack is a series of its own: give {stack}." if stack else ""
    return (
        f"no images in {image_path}{said}; files ending in {', '.join(IMAGE_SUFFIXES)} are "
        f"looked for.{hint}"
    )


def check_enough(usable: int, found: int, image_path: Path, problems: Sequence[str]) -> None:
    """Refuse fewer than three usable images, saying what became of the others."""
    if usable >= MIN_IMAGES:
        return
    lost = f" of {found}" if found != usable else ""
    said = f" ({problems[0]})" if found != usable and problems else ""
    if usable == 0:
        raise InputError(f"none of the {found} images in {image_path} can be used{said}.")
    images = "images" if usable > 1 or lost else "image"
    raise InputError(
        f"only {usable}{lost} {images} in {image_path} can be used{said}: "
        "two parallel projections leave a one-parameter family of shapes, so at least three views "
        "are needed."
    )
