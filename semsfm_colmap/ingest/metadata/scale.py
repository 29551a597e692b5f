"""The pixel size of the stored image, from values that may belong to another raster.

A header may give the size of a pixel, the width and the height of the field of view, and the raster
they were recorded for. The image may since have been resized (the field is the same, the pixels
are not), cropped (the pixels are the same, the field is not) or turned by a quarter (width and
height are exchanged). Comparing the candidates with the stored raster tells which.
"""

from __future__ import annotations

from dataclasses import dataclass

AGREEMENT = 0.01
"""Relative difference up to which two candidates agree: headers are rounded to 3-4 digits."""
ASPECT_AGREEMENT = 0.02


@dataclass(frozen=True, kw_only=True)
class PixelSize:
    """The pixel size of the stored image with its source, and what was found odd."""

    um: float | None
    source: str = ""
    warning: str | None = None


def stored_pixel_size(
    *,
    width: int,
    height: int,
    image_rows: int | None,
    pixel: tuple[float, str] | None,
    field_width: tuple[float, str] | None,
    field_height: tuple[float, str] | None = None,
    recorded_raster: tuple[int, int] | None = None,
    databar_rows: int = 0,
) -> PixelSize:
    """Reconcile a header's pixel size (um) with its field of view (um) and the stored raster (px).

    `image_rows` are the rows the field's height refers to, where they are not `height`;
    `databar_rows` those the microscope added below the recorded raster.
    """
    if pixel is None and field_width is None:
        return PixelSize(um=None)
    if recorded_raster and min(recorded_raster) < 1:
        recorded_raster = None
    if recorded_raster and recorded_raster != (width, height):
        changed = _changed_raster(
            width, height, image_rows, pixel, field_width, recorded_raster, databar_rows
        )
        if changed is not None:
            return changed
    if field_width is None:
        assert pixel is not None
        return PixelSize(um=pixel[0], source=pixel[1])
    by_field = field_width[0] / width
    if pixel is None:
        return PixelSize(um=by_field, source=f"{field_width[1]} / image width")
    if abs(by_field - pixel[0]) <= AGREEMENT * pixel[0]:
        return PixelSize(um=pixel[0], source=pixel[1])
    rows = image_rows or height
    if field_height is not None:
        aspect = field_width[0] / field_height[0]
        if abs(aspect * rows / width - 1) <= ASPECT_AGREEMENT:
            return PixelSize(
                um=by_field,
                source=f"{field_width[1]} / image width",
                warning=f"{pixel[1]} says {pixel[0]:.6g} um but {field_width[1]} over the "
                f"{width} px stored gives {by_field:.6g} um, as after resizing; the latter is "
                "used, give pixel_size_um if it is wrong",
            )
        if abs(aspect * width / rows - 1) <= ASPECT_AGREEMENT:
            return PixelSize(
                um=field_width[0] / rows,
                source=f"{field_width[1]} / image height",
                warning="width and height are exchanged against the header, as after turning "
                "the image by 90 degrees; its tilt axis is turned too",
            )
    return PixelSize(
        um=pixel[0],
        source=pixel[1],
        warning=f"{pixel[1]} says {pixel[0]:.6g} um but {field_width[1]} over the {width} px "
        f"stored gives {by_field:.6g} um; the former is used (as for a cropped image), give "
        "pixel_size_um if it is wrong",
    )


def _changed_raster(
    width: int,
    height: int,
    image_rows: int | None,
    pixel: tuple[float, str] | None,
    field_width: tuple[float, str] | None,
    recorded: tuple[int, int],
    databar_rows: int,
) -> PixelSize | None:
    """The pixel size when the header states another raster than the stored one."""
    recorded_pixel = (
        pixel
        if pixel is not None
        else (field_width[0] / recorded[0], f"{field_width[1]} / recorded width")
        if field_width is not None
        else None
    )
    assert recorded_pixel is not None
    um, source = recorded_pixel
    if recorded[0] == width:
        return None  # a databar was added below or cut off
    said = f"the header was recorded for {recorded[0]} x {recorded[1]} px"
    if (height, width) in (recorded, (recorded[0], recorded[1] + databar_rows)):
        return PixelSize(
            um=um,
            source=source,
            warning=f"{said} but the image has {width} x {height}, as after turning it by 90 "
            "degrees; its tilt axis is turned too",
        )
    factor = recorded[0] / width
    for recorded_rows, rows in (
        (recorded[1], height),
        (recorded[1] + databar_rows, height),
        (recorded[1], image_rows or height),
    ):
        if abs(recorded_rows / rows / factor - 1) <= ASPECT_AGREEMENT:
            return PixelSize(
                um=um * factor,
                source=f"{source} x {factor:.4g} (resized)",
                warning=f"{said} but the image has {width} x {height}, as after resizing; the "
                f"pixel size was multiplied by {factor:.4g}, give pixel_size_um if it is wrong",
            )
    return PixelSize(
        um=um,
        source=source,
        warning=f"{said} but the image has {width} x {height}; its pixel size is kept (as for a "
        "cropped image), give pixel_size_um if it is wrong",
    )
