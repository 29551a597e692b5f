"""Options of the ingest stage: where the images are trusted, where they are overridden."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from semsfm_colmap.bounds import Checked, Count, NotNegative, Percentile, Positive


@dataclass(frozen=True, kw_only=True)
class IngestOptions(Checked):
    """How source images become the prepared 8-bit images of a project."""

    pixel_size_um: Positive | None = None
    """Size of one pixel of the stored images in micrometres; overrides what the files say."""
    scale_bar_um: Positive | None = None
    """What is written at the burnt-in scale bar, in micrometres; its length is then measured in px
    and gives the pixel size where the files record none."""
    series_csv: Path | None = None
    """Table with a column image and any of tilt_deg, rotation_deg, displacement_um, pixel_size_um;
    overrides what the files say."""
    tilt_from_names: bool = False
    """Take the tilt in degrees from the end of the files' names: tilt_-10.tif, tilt_n10.tif
    (minus), tilt_p10.tif. Overrides the headers; a table overrides the names."""
    tilt_step_deg: float | None = None
    """Nominal tilt between consecutive images, where neither files nor table give a tilt."""
    degrees_per_um: Positive | None = None
    """Calibrated rotation per displacement of the actuator: the displacements in the table are then
    known tilts, where none are. Not needed: without it the images say what it is."""
    tilt_axis: str = "auto"
    """Direction of the tilt axis in the images: auto, x, y, or degrees from x toward y. The images
    show it better than one can say it; where they contradict, that is reported."""
    tilt_sigma_deg: Positive | None = None
    """Standard deviation of the recorded tilts; default 0.2 for a table, 0.5 for a stage, a tenth
    of the step for tilt_step_deg."""
    crop: tuple[int, int, int, int] | None = None
    """Part of every image to keep, "x0 y0 x1 y1" in px (x1, y1 excluded); no databar is then
    searched."""
    detect_databar: bool = True
    """Find the burnt-in databar at the bottom and cut it off."""
    max_image_pixels: Count = 400_000_000
    """Images whose header claims more pixels than this are refused before memory is taken."""
    masks: Literal["off", "given", "foreground", "motion", "auto"] = "given"
    """Masks to write: none; those found in a masks folder, and one for writing burnt into the
    images; also the specimen on an empty background; also what moves before a static scene; or all
    of them."""
    masks_path: Path | None = None
    """Folder with masks named <image name>.png (0 = ignore); default: a folder "masks" in or
    beside the image folder."""
    range_percentiles: tuple[Percentile, Percentile] = (0.1, 99.9)
    """Percentiles of the grey values that become 0 and 255 when more than 8 bits are reduced."""
    flat_field: bool = False
    """Even out the slow change of brightness across the image."""
    flat_field_scale: Positive = 0.15
    """What counts as slow: standard deviation of the smoothing, relative to the longer side."""
    denoise: Literal["off", "median", "gaussian", "nlm"] = "off"
    """Reduce noise: 3 x 3 median, Gaussian of 1 px, or non-local means."""
    local_contrast: NotNegative = 0.0
    """Clip limit of the local histogram equalisation (2 to 4 are usual); 0 = off."""

    def contradictions(self) -> list[tuple[str, str]]:
        """A part of an image has an extent, and percentiles rise."""
        found = []
        if self.crop is not None and not (
            0 <= self.crop[0] < self.crop[2] and 0 <= self.crop[1] < self.crop[3]
        ):
            found.append(("crop", "give x0 y0 x1 y1 with 0 <= x0 < x1 and 0 <= y0 < y1"))
        if not self.range_percentiles[0] < self.range_percentiles[1]:
            found.append(("range_percentiles", "give the lower one first"))
        return found
