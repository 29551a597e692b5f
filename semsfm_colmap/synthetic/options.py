"""Options of the synthetic series, and the preset of the small example."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from annotated_types import Ge

from semsfm_colmap.bounds import Checked, Count, CountOrNone, NotNegative, Positive, Seed, Share

SceneName = Literal["grain", "field", "clump", "cap", "step", "pyramid", "cylinder"]


@dataclass(frozen=True, kw_only=True)
class SynthesizeOptions(Checked):
    """What is rendered, how it is turned, and what the microscope adds to it.

    Where a default is None the scene brings its own.
    """

    scene: SceneName = "grain"
    """A spiny pollen grain on a stalk, a rough electroplated field that fills the frame and is
    tilted, a clump of spores on a helical ribbon that turns it, or a shape of exactly known sizes
    on a plate that is tilted: the cap of a sphere, a step of 2 um, a pyramid, a rod."""
    seed: Seed = 7
    """Seed of the specimen, the motion and the noise: the same seed gives the same bytes."""
    series_seed: Seed | None = None
    """Seed of the motion and the noise, for another series of the specimen that `seed` makes;
    default: seed."""
    mount_deg: float = 0.0
    """Angle about the beam by which the specimen is mounted, before it is turned: two series of
    one specimen that differ by 90 turn it about perpendicular axes."""

    num_images: Count | None = None
    """Number of images; default: grain 48, clump 72, step 20, other shapes 10, field 13."""
    range_deg: float | None = None
    """Angle between the first and the last image; default: grain 180, clump 355, field and
    shapes 60."""
    step_deg: float | None = None
    """Angle between consecutive images, instead of range_deg."""
    start_deg: float | None = None
    """Angle of the first image; default: grain and clump 0, field and shapes half the range
    below 0."""
    rotation_axis: Literal["x", "y"] | None = None
    """Image axis nearest to the axis of rotation; default: grain y, others x."""
    axis_error_deg: NotNegative = 1.0
    """Standard deviation of the angle between the axis of rotation and that image axis."""
    step_error_deg: NotNegative = 0.1
    """Standard deviation of an angle against its nominal value."""
    wobble_deg: NotNegative = 0.15
    """Standard deviation of the rotation left over beside the turn, about each axis."""
    stage_drift_px: NotNegative = 8.0
    """Standard deviation of the shift from one image to the next, in both directions."""
    magnification_drift: float = 0.0005
    """Relative change of the magnification from the first image to the last."""

    width_px: Annotated[int, Ge(16)] = 1024
    """Width of the images."""
    height_px: Annotated[int, Ge(16)] = 768
    """Height of the images, databar included."""
    databar: bool = True
    """Burn a databar into the bottom rows, as microscopes do."""
    databar_rows: CountOrNone = 60
    """Height of the databar."""
    zoom: Positive = 1.0
    """Magnification relative to the natural framing of the scene."""
    pixel_size_um: Positive | None = None
    """Size of a pixel; default: what gives the specimen its natural size."""

    supersampling: Count = 2
    """Rays per pixel along each axis."""
    mesh_edge_px: Positive = 1.5
    """Length of the edges of the specimen's triangles; what is finer is not there."""
    albedo_contrast: NotNegative = 0.18
    """Standard deviation of the relative brightness of the material, apart from its relief."""
    secant_exponent: float = 0.95
    """Brightness grows with this power of 1 / cos of the angle between normal and beam."""
    detector_strength: NotNegative = 0.45
    """How much brighter is what faces the detector, and darker what faces away."""
    edge_strength: NotNegative = 0.5
    """Brightening of ridges and darkening of grooves."""
    thin_strength: NotNegative = 0.9
    """Brightening of parts thinner than the range of the electrons."""
    cavity_strength: Share = 0.75
    """Darkening of cavities that electrons do not escape from, 0 to 1."""
    shadowing: Share = 0.0
    """Darkness of the shadow on what has no straight way to the detector, 0 to 1."""

    counts: NotNegative = 220.0
    """Electrons counted in a pixel of grey value 0.4: the shot noise."""
    psf_px: NotNegative = 0.8
    """Standard deviation of the beam profile, varied by 10 % between images."""
    charging: Share = 0.0
    """Charge of a specimen that does not conduct, 0 to 1: dark streaks behind bright parts along
    the scan lines and a glow that is another in each image."""
    gain_change: NotNegative = 0.06
    """Standard deviation of the relative brightness between images."""
    row_jitter_px: NotNegative = 0.1
    """Standard deviation of the sideways displacement of each scan line."""
    frame_drift_px: NotNegative = 0.2
    """Standard deviation of the drift between the first scan line and the last."""

    degrees_per_um: float = 171.3
    """Rotation of the helical ribbon per displacement of its actuator; clump only."""
    displacement_noise_um: NotNegative = 0.001
    """Standard deviation of the recorded displacement; clump only."""

    image_format: Literal["png", "tif"] = "png"
    """File format of the images."""
    zeiss_header: bool = True
    """Write the header of a Zeiss microscope with pixel size and stage tilt; tif only."""


def example_options() -> SynthesizeOptions:
    """The small example: 24 TIFFs of a spiny grain, 640 x 480 above a databar, 115 degrees."""
    return SynthesizeOptions(
        scene="grain",
        num_images=24,
        step_deg=5.0,
        width_px=640,
        height_px=520,
        databar_rows=40,
        image_format="tif",
    )
