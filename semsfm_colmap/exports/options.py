"""Options of the exports to other programs."""

from __future__ import annotations

from dataclasses import dataclass

from semsfm_colmap.bounds import Angle, Checked, Count, CountOrNone, NotNegative, Positive


@dataclass(frozen=True, kw_only=True)
class FormatOptions(Checked):
    """The pinhole camera that stands in for parallel projection, and what goes beside it.

    The focal length is measured in the longer side of the image: f = k max(W, H).
    """

    max_deviation_px: NotNegative = 0.0
    """Largest distance between pinhole and parallel projection, formats in double precision; 0
    keeps the focal length of the project's own model."""
    max_float32_deviation_px: Positive = 0.25
    """The same for programs in float32; k is chosen between the next two."""
    min_float32_focal_factor: Positive = 300.0
    """Smallest k of the float32 formats."""
    max_float32_focal_factor: Positive = 1000.0
    """Largest k of the float32 formats; depths are good to k max(W, H) / 1e7 px."""
    focal_factor: NotNegative = 0.0
    """This k in place of the chosen one; 0 chooses."""
    plain_names: bool = False
    """Copy the images as image_0001.png, ...; names.csv holds the names they had."""
    grey_images: bool = False
    """Copy grey images as they are, not as RGB (colmap-float32, nerfstudio, openmvs), for programs
    that read grey ones."""
    fusion_consistency_px: NotNegative = 3.0
    """Depths that COLMAP's stereo fusion takes for the same surface (colmap-dense)."""
    min_fusion_pixels: Count = 3
    """Depth pixels that a point of stereo fusion has at least."""
    scale_factor: Positive = 1000.0
    """Size of the print over that of the specimen (stl, 3mf): 1000 is a millimetre for a
    micrometre, or for 1000 px."""
    max_fiducials: CountOrNone = 200
    """So many of the longest tracks become fiducials (imod)."""
    num_source_images: Count = 10
    """Source images of a reference in patch-match.cfg."""
    max_source_angle_deg: Angle = 30.0
    """Source images at a larger angle are left out unless none is nearer."""

    def contradictions(self) -> list[tuple[str, str]]:
        """The smallest focal length is no larger than the largest."""
        if self.min_float32_focal_factor > self.max_float32_focal_factor:
            return [("min_float32_focal_factor", "give no more than max_float32_focal_factor")]
        return []
