"""What the header of an image file says, and the refusal of a file."""

from __future__ import annotations

from dataclasses import dataclass

from semsfm_colmap.errors import InputError


class UnreadableImageError(InputError):
    """One file cannot be used; the message is the sentence to show, without the file's name."""


@dataclass(frozen=True, kw_only=True)
class ImageHeader:
    """What the header of a file says about its pixels."""

    format: str
    width: int
    height: int
    bits: int
    channels: int
    page: int = 0
    """The page of a TIFF that holds the image."""
    orientation: int = 1
    """EXIF orientation; 1 = as stored."""
    lossy: bool = False
    """Whether the pixels were compressed with loss, so that drawn values are only nearly exact."""
    image_rows: int | None = None
    """Rows above a databar that was seen in the pixels."""
    num_pages: int = 1
    """Pages of the size of this one that the file holds."""
