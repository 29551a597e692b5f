"""Options of the ingest stage: where the images are trusted, where they are overridden."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal


@dataclass(frozen=True, kw_only=True)
class IngestOptions:
    """How source images become the prepared 8-bit images of a project."""

    pixel_size_um: float | None = None
    """Size of one pixel of the stored images in micrometres; overrides what the files say."""
    crop: tuple[int, int, int, int] | None = None
    """Part of every image to keep, "x0 y0 x1 y1" in px (x1, y1 excluded); no databar is then
    searched."""
    detect_databar: bool = True
    """Find the burnt-in databar at the bottom and cut it off."""
    max_image_pixels: int = 400_000_000
    """Images whose header claims more pixels than this are refused before memory is taken."""
    range_percentiles: tuple[float, float] = (0.1, 99.9)
    """Percentiles of the grey values that become 0 and 255 when more than 8 bits are reduced."""
    masks: Literal["off", "given", "foreground"] = "given"
    """Masks to write: none, those found in a masks folder beside the images, or also an automatic
    one of the specimen on an empty background."""
    masks_path: Path | None = None
    """Folder with masks named <image name>.png (0 = ignore); default: a folder "masks" in or
    beside the image folder."""
