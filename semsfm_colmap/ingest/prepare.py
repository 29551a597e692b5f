"""The stage: a folder of microscope files becomes PROJECT/images and a `SemSeries`.

The originals are only read. Each output is written whole or not at all, and what an earlier
run of this stage left behind is removed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path, PurePosixPath

import numpy as np

from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.ingest.convert import to_grey8
from semsfm_colmap.ingest.files import IMAGE_SUFFIXES, find_images
from semsfm_colmap.ingest.masks import find_masks_folder, given_mask
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.ingest.output import (
    LOSSLESS_SUFFIXES,
    encode_grey8,
    remove_stale,
    write_atomic,
)
from semsfm_colmap.ingest.pixel_size import series_pixel_size
from semsfm_colmap.ingest.raster import RawImage, UnreadableImageError, read_pixels
from semsfm_colmap.ingest.scan import (
    Progress,
    SourceImage,
    check_crop,
    choose_crops,
    scan_images,
)
from semsfm_colmap.ingest.series_file import SERIES_FILE, read_written_files, write_series
from semsfm_colmap.types import SemFrame, SemSeries

MIN_IMAGES = 3
"""Two orthographic views leave a one-parameter family of shapes [Koenderink, van Doorn 1991]."""


def prepare_series(
    image_path: Path,
    project_path: Path,
    options: IngestOptions,
    *,
    progress: Progress | None = None,
) -> SemSeries:
    """Read the images below `image_path`, write the prepared ones to PROJECT/images.

    Also writes PROJECT/masks where there are masks, and PROJECT/series.json. ``progress(done,
    total)`` is called after each file of either of the two passes.
    """
    image_path, project_path = Path(image_path), Path(project_path)
    check_options(options)
    found = find_images(image_path, project_path)
    check_paths(image_path, project_path)
    if not found.names:
        raise InputError(_no_images(image_path, found.warnings))
    total = 2 * len(found.names)
    images, problems = scan_images(
        image_path, found.names, options, (lambda n, _: progress(n, total)) if progress else None
    )
    warnings = [*found.warnings, *problems]
    images, problems = choose_crops(images, options)
    warnings += problems
    _check_enough(len(images), len(found.names), image_path, warnings)
    written_images, written_masks = read_written_files(project_path / SERIES_FILE)
    names = prepared_names(images)
    masks_folder = find_masks_folder(image_path, options)
    frames: list[SemFrame] = []
    masks: list[str] = []
    for count, (image, name) in enumerate(zip(images, names, strict=True)):
        try:
            frame, mask_name = _prepare_image(image, name, project_path, masks_folder, options)
        except UnreadableImageError as error:
            warnings.append(f"{image.name}: {error} Left out.")
            continue
        frames.append(frame)
        if mask_name:
            masks.append(mask_name)
        if progress:
            progress(len(found.names) + count + 1, total)
    _check_enough(len(frames), len(found.names), image_path, warnings)
    pixel_size = series_pixel_size(frames, options.pixel_size_um)
    series = SemSeries(
        frames=tuple(frames),
        pixel_size_um=pixel_size.um,
        pixel_size_source=pixel_size.source,
        warnings=(*warnings, *pixel_size.warnings),
    )
    write_series(series, project_path / SERIES_FILE, masks=tuple(masks))
    remove_stale(project_path / "images", written_images, set(series.names))
    remove_stale(project_path / "masks", written_masks, set(masks))
    if progress:
        progress(total, total)
    return series


def check_options(options: IngestOptions) -> None:
    """Refuse values that no series can have."""
    um = options.pixel_size_um
    if um is not None and not (math.isfinite(um) and um > 0):
        raise UsageError(f"pixel_size_um = {um} but expected a positive number of micrometres.")
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


def check_paths(image_path: Path, project_path: Path) -> None:
    """Refuse to write over the originals."""
    if image_path.resolve() in (
        (project_path / "images").resolve(),
        (project_path / "masks").resolve(),
    ):
        raise UsageError(
            f"{image_path} is where the prepared images are written; give another output_path, "
            "or move the originals elsewhere."
        )


def prepared_names(images: Sequence[SourceImage]) -> list[str]:
    """Name of each prepared image: kept where the format can hold it, else with ``.png``."""
    names: dict[str, str] = {}
    for image in images:
        suffix = PurePosixPath(image.name).suffix
        keeps = suffix.lower() in LOSSLESS_SUFFIXES or _keeps_jpeg(image)
        name = image.name if keeps else image.name[: len(image.name) - len(suffix)] + ".png"
        if name in names:
            raise InputError(
                f"both {names[name]} and {image.name} would be prepared as {name}; rename one."
            )
        names[name] = image.name
    return list(names)


def _keeps_jpeg(image: SourceImage) -> bool:
    """A JPEG of which nothing is changed is copied: decoding it again would not make it better."""
    return (
        image.header.format == "jpeg"
        and PurePosixPath(image.name).suffix.lower() in (".jpg", ".jpeg")
        and image.header.orientation == 1
        and image.header.channels in (1, 3)
        and image.crop == (0, 0, *image.size)
    )


def _prepare_image(
    image: SourceImage,
    name: str,
    project_path: Path,
    masks_folder: Path | None,
    options: IngestOptions,
) -> tuple[SemFrame, str | None]:
    """Write one image and its mask; returns the frame and the mask's name if there is one."""
    raw = read_pixels(image.path, image.header)
    suffix = PurePosixPath(name).suffix.lower()
    x0, y0, x1, y1 = image.crop
    if _stays_as_it_is(image, raw, suffix):
        content = image.path.read_bytes()
    else:
        cropped = raw.pixels[y0:y1, x0:x1]
        if cropped.min() == cropped.max():
            raise UnreadableImageError("every pixel of the cropped image has the same value.")
        grey, _ = to_grey8(cropped, options.range_percentiles)
        content = encode_grey8(grey, suffix)
    write_atomic(project_path / "images" / name, content)
    warnings = list(image.warnings)
    mask_name = None
    if masks_folder is not None:
        mask, problem = given_mask(masks_folder, image, options)
        warnings += [problem] if problem else []
        if mask is not None:
            mask_name = f"{name}.png"
            drawn = np.where(mask, np.uint8(255), np.uint8(0))
            write_atomic(project_path / "masks" / mask_name, encode_grey8(drawn, ".png"))
    frame = SemFrame(
        name=name,
        width_px=x1 - x0,
        height_px=y1 - y0,
        source_path=str(image.path),
        crop_px=image.crop,
        metadata=image.reading.metadata,
        warnings=tuple(warnings),
    )
    return frame, mask_name


def _stays_as_it_is(image: SourceImage, raw: RawImage, suffix: str) -> bool:
    if image.crop != (0, 0, *image.size) or not raw.plain:
        return False
    return (image.header.format, suffix) in (("jpeg", ".jpg"), ("jpeg", ".jpeg"), ("png", ".png"))


def _no_images(image_path: Path, problems: Sequence[str]) -> str:
    said = f" ({problems[0]})" if problems else ""
    return (
        f"no images in {image_path}{said}; files ending in {', '.join(IMAGE_SUFFIXES)} are "
        "looked for."
    )


def _check_enough(usable: int, found: int, image_path: Path, problems: Sequence[str]) -> None:
    if usable >= MIN_IMAGES:
        return
    lost = f" of {found}" if found != usable else ""
    said = f" ({problems[0]})" if found != usable and problems else ""
    if usable == 0:
        raise InputError(f"none of the {found} images in {image_path} can be used{said}.")
    raise InputError(
        f"only {usable}{lost} image{'s' if usable > 1 else ''} in {image_path} can be used{said}: "
        "two parallel projections leave a one-parameter family of shapes, so at least three views "
        "are needed."
    )
