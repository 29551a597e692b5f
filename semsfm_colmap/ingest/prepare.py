"""The stage: a folder of microscope files becomes PROJECT/images and a `SemSeries`.

The originals are only read. Each output is written whole or not at all, and what an earlier
run of this stage left behind is removed.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path, PurePosixPath

import numpy as np

from semsfm_colmap.errors import InputError
from semsfm_colmap.ingest.files.bit_depth import to_grey8
from semsfm_colmap.ingest.files.encode import LOSSLESS_SUFFIXES, encode_grey8
from semsfm_colmap.ingest.files.header import UnreadableImageError
from semsfm_colmap.ingest.files.listing import find_images
from semsfm_colmap.ingest.files.raster import RawImage
from semsfm_colmap.ingest.files.read import read_pixels
from semsfm_colmap.ingest.files.stale import remove_stale
from semsfm_colmap.ingest.frame.enhance import changes_pixels, prepare_pixels
from semsfm_colmap.ingest.frame.source import SourceImage, check_content
from semsfm_colmap.ingest.masks.combine import SeriesMasks
from semsfm_colmap.ingest.masks.given import find_masks_folder
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.ingest.series.crops import choose_crops
from semsfm_colmap.ingest.series.file import (
    PreparationRecord,
    read_written_files,
    write_series,
)
from semsfm_colmap.ingest.series.overrides import apply_scale_bars, apply_tables
from semsfm_colmap.ingest.series.pixel_size import leave_out_magnifications, series_pixel_size
from semsfm_colmap.ingest.series.refusals import (
    check_enough,
    check_options,
    check_paths,
    no_images_message,
)
from semsfm_colmap.ingest.series.remarks import frame_warnings, series_warnings
from semsfm_colmap.ingest.series.scan import Progress, scan_images
from semsfm_colmap.ingest.series.table import read_series_table
from semsfm_colmap.io.atomic import write_bytes
from semsfm_colmap.io.layout import IMAGES_FOLDER, MASKS_FOLDER, SERIES_FILE
from semsfm_colmap.io.names import as_on_disk
from semsfm_colmap.types import Array, SemFrame, SemSeries


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
    if options.series_csv:
        read_series_table(options.series_csv)  # what is wrong with it is said before the images
    if not found.names:
        raise InputError(no_images_message(image_path, found.warnings))
    total = 2 * len(found.names)
    scan = scan_images(
        image_path, found.names, options, (lambda n, _: progress(n, total)) if progress else None
    )
    warnings = [*found.warnings, *scan.problems]
    images, problems = choose_crops(scan.images, options, scan.overlays)
    warnings += problems
    check_enough(len(images), len(found.names), image_path, warnings)
    images, problems = _with_overrides(images, options)
    warnings += problems
    images, problems = leave_out_magnifications(images, options.pixel_size_um)
    warnings += problems
    check_enough(len(images), len(found.names), image_path, problems or warnings)
    names = prepared_names(images)
    masks = SeriesMasks(options, find_masks_folder(image_path, options), scan.overlays)
    written = read_written_files(project_path / SERIES_FILE)
    frames: list[SemFrame] = []
    record = PreparationRecord.of(options)
    for count, (image, name) in enumerate(zip(images, names, strict=True)):
        try:
            frames.append(_prepare_image(image, name, project_path, masks, record, options))
        except UnreadableImageError as error:
            warnings.append(f"{image.name}: {error} Left out.")
        if progress:
            progress(len(found.names) + count + 1, total)
    check_enough(len(frames), len(found.names), image_path, warnings)
    mask_names = _write_masks(masks, project_path, record)
    pixel_size = series_pixel_size(frames, options.pixel_size_um)
    series = SemSeries(
        frames=tuple(frames),
        pixel_size_um=pixel_size.um,
        pixel_size_source=pixel_size.source,
        warnings=(
            *warnings,
            *frame_warnings(frames),
            *masks.warnings,
            *pixel_size.warnings,
            *series_warnings(frames),
        ),
    )
    write_series(series, project_path / SERIES_FILE, record=record)
    remove_stale(project_path / IMAGES_FOLDER, written.images, set(series.names))
    remove_stale(project_path / MASKS_FOLDER, written.masks, set(mask_names))
    if progress:
        progress(total, total)
    return series


def prepared_names(images: Sequence[SourceImage]) -> list[str]:
    """Name of each prepared image: kept where the format can hold it, else with ``.png``."""
    names: dict[str, tuple[str, str]] = {}
    for image in images:
        suffix = PurePosixPath(image.name).suffix
        keeps = suffix.lower() in LOSSLESS_SUFFIXES or _keeps_jpeg(image)
        name = image.name if keeps else image.name[: len(image.name) - len(suffix)] + ".png"
        key = as_on_disk(name)
        if key in names:
            other = names[key][0]
            raise InputError(
                f"both {other} and {image.name} would be prepared as {name}; rename one."
            )
        names[key] = image.name, name
    return [name for _, name in names.values()]


def _with_overrides(
    images: Sequence[SourceImage], options: IngestOptions
) -> tuple[list[SourceImage], list[str]]:
    """Complete the metadata by scale bar and table, the table having the last word."""
    changed, problems = apply_scale_bars(images, options)
    changed, more = apply_tables(changed, options)
    return changed, [*problems, *more]


def _keeps_jpeg(image: SourceImage) -> bool:
    """A JPEG of which nothing is changed is copied: decoding it again would not make it better."""
    return (
        image.header.format == "jpeg"
        and PurePosixPath(image.name).suffix.lower() in (".jpg", ".jpeg")
        and image.header.orientation == 1
        and image.header.channels in (1, 3)
        and image.crop == (0, 0, *image.size)
        and not image.changes
    )


def _prepare_image(
    image: SourceImage,
    name: str,
    project_path: Path,
    masks: SeriesMasks,
    record: PreparationRecord,
    options: IngestOptions,
) -> SemFrame:
    """Write one image and hand it to the masks."""
    raw = read_pixels(image.path, image.header)
    suffix = PurePosixPath(name).suffix.lower()
    x0, y0, x1, y1 = image.crop
    cropped = raw.pixels[y0:y1, x0:x1]
    check_content(cropped)
    grey, grey_range = to_grey8(cropped, options.range_percentiles)
    if changes_pixels(options):
        grey = prepare_pixels(grey, options)
    stays = _stays_as_it_is(image, raw, suffix)
    content = _stored(image.path) if stays else encode_grey8(grey, suffix)
    write_bytes(content, project_path / IMAGES_FOLDER / name)
    record.grey_range[name] = grey_range
    problems = masks.add(image, name, np.asarray(grey), raw)
    return SemFrame(
        name=name,
        width_px=x1 - x0,
        height_px=y1 - y0,
        source_path=str(image.path),
        crop_px=image.crop,
        metadata=image.reading.metadata,
        warnings=(*image.warnings, *problems),
        databar=image.databar_row is not None,
    )


def _stored(path: Path) -> bytes:
    """The file as it is, which may have gone since its pixels were read."""
    try:
        return path.read_bytes()
    except OSError as error:
        raise UnreadableImageError(f"cannot be read: {error.strerror}.") from error


def _write_masks(masks: SeriesMasks, project_path: Path, record: PreparationRecord) -> list[str]:
    """Write the masks in COLMAP's convention; returns their file names."""
    written = []
    for name, usable in masks.finish().items():
        drawn: Array = np.where(usable, np.uint8(255), np.uint8(0))
        write_bytes(encode_grey8(drawn, ".png"), project_path / MASKS_FOLDER / f"{name}.png")
        record.mask_effect[name] = (masks.effects[name].area, masks.effects[name].texture)
        written.append(f"{name}.png")
    record.masks.extend(written)
    return written


def _stays_as_it_is(image: SourceImage, raw: RawImage, suffix: str) -> bool:
    if image.crop != (0, 0, *image.size) or not raw.plain or image.changes:
        return False
    return (image.header.format, suffix) in (("jpeg", ".jpg"), ("jpeg", ".jpeg"), ("png", ".png"))
