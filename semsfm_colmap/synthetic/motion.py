"""Where the cameras of a series stand: turn, wobble, drift, and what each frame distorts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from semsfm_colmap.errors import UsageError
from semsfm_colmap.geometry.rotations import rotation_from_vector
from semsfm_colmap.synthetic.options import SynthesizeOptions
from semsfm_colmap.synthetic.scenes.base import View
from semsfm_colmap.types import Float, OrthographicCameras


@dataclass(frozen=True, kw_only=True)
class SceneDefaults:
    """What a scene brings where the options say None."""

    num_images: int
    range_deg: float
    centred: bool
    """Whether the angles run from -range / 2, or from 0"""
    rotation_axis: str
    half_extent: tuple[float, float]
    """Half width and half height, in scene units, that must fit into the image area"""
    centre: tuple[float, float]
    """Where the origin of the scene appears, as a fraction of the image area"""
    unit_um: float
    tilted: bool = False
    """Whether it is a sheet that the stage tilts: it fills the frame whatever its shape"""


def plate(num_images: int) -> SceneDefaults:
    """A shape on a plate."""
    return SceneDefaults(
        num_images=num_images,
        range_deg=60.0,
        centred=True,
        rotation_axis="x",
        half_extent=(1.6, 1.2),
        centre=(0.5, 0.5),
        unit_um=2.5,
        tilted=True,
    )


SCENE_DEFAULTS = {
    "grain": SceneDefaults(
        num_images=48,
        range_deg=180.0,
        centred=False,
        rotation_axis="y",
        half_extent=(1.52, 1.52),
        centre=(0.5, 0.5),
        unit_um=15.0,
    ),
    "field": SceneDefaults(
        num_images=13,
        range_deg=60.0,
        centred=True,
        rotation_axis="x",
        half_extent=(1.5, 1.5),
        centre=(0.5, 0.5),
        unit_um=20.0,
        tilted=True,
    ),
    "clump": SceneDefaults(
        num_images=72,
        range_deg=355.0,
        centred=False,
        rotation_axis="x",
        half_extent=(1.9, 1.5),
        centre=(0.46, 0.5),
        unit_um=4.0,
    ),
    "cap": plate(10),
    "step": plate(20),
    "pyramid": plate(10),
    "cylinder": plate(10),
}

DRIFT_MEMORY = 0.85
"""Share of the stage's offset that is left at the next image: keeps the specimen in view."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """Cameras of a series and the departures from them, M images of H scan lines."""

    cameras: OrthographicCameras
    nominal_deg: Float
    """(M,) what the stage was asked for"""
    true_deg: Float
    """(M,) what it did, about `axis`"""
    axis: Float
    """(3,) axis of rotation in the frame of the camera at angle 0"""
    unit_um: float
    frame_drift_px: Float
    """(M, 2) drift from the first scan line to the last"""
    row_jitter_px: Float
    """(M, H) sideways displacement of each scan line"""
    psf_px: Float
    """(M,) standard deviation of the beam profile"""
    gain: Float
    """(M,) relative brightness"""
    displacement_um: Float | None = None
    """(M,) recorded displacement of the actuator"""

    def row_shift_px(self, image_idx: int) -> Float:
        """(H, 2): a point of the camera model at (u, v) appears at (u, v) + shift of its row."""
        rows = self.row_jitter_px.shape[1]
        ramp = (np.arange(rows) + 0.5) / rows - 0.5
        shift = ramp[:, None] * self.frame_drift_px[image_idx]
        shift[:, 0] += self.row_jitter_px[image_idx]
        return np.asarray(shift)


def image_rows(options: SynthesizeOptions) -> int:
    """Rows of the image area, above the databar."""
    rows = options.height_px - (options.databar_rows if options.databar else 0)
    if rows < 16 or options.width_px < 16:
        raise UsageError(
            f"{options.width_px=}, {options.height_px=} leave {rows} rows above the databar but"
            " expected at least 16 x 16 px of image."
        )
    return rows


def nominal_angles_deg(options: SynthesizeOptions) -> Float:
    """(M,) nominal angles of the series."""
    defaults = SCENE_DEFAULTS[options.scene]
    num = defaults.num_images if options.num_images is None else options.num_images
    if num < 1:
        raise UsageError(f"num_images={num} but expected at least 1.")
    if options.range_deg is not None and options.step_deg is not None:
        raise UsageError("Both range_deg and step_deg are given: leave one of them out.")
    range_deg = defaults.range_deg if options.range_deg is None else options.range_deg
    if options.step_deg is not None:
        range_deg = options.step_deg * (num - 1)
    start = options.start_deg
    if start is None:
        start = -0.5 * range_deg if defaults.centred else 0.0
    return np.asarray(np.linspace(start, start + range_deg, num))


def nominal_scale(options: SynthesizeOptions) -> float:
    """Magnification in px per scene unit."""
    half_x, half_y = SCENE_DEFAULTS[options.scene].half_extent
    fit = min(0.5 * options.width_px / half_x, 0.5 * image_rows(options) / half_y)
    if SCENE_DEFAULTS[options.scene].tilted:
        fit = 0.5 * image_rows(options) / half_y
    if options.zoom <= 0:
        raise UsageError(f"{options.zoom=} but expected a positive factor.")
    return options.zoom * fit


def random_streams(options: SynthesizeOptions) -> tuple[np.random.Generator, ...]:
    """One stream a purpose, so that a change in one leaves the others as they were.

    Returns
    -------
    Those of the motion, the specimen, its surface, and the noise

    """
    motion, specimen, surface, noise = np.random.default_rng(options.seed).spawn(4)
    if options.series_seed is not None:
        motion, _, _, noise = np.random.default_rng(options.series_seed).spawn(4)
    return motion, specimen, surface, noise


def mounting(options: SynthesizeOptions) -> Float:
    """(3, 3) how the specimen is mounted: turned about the beam."""
    return rotation_from_vector(np.radians([0.0, 0.0, options.mount_deg]))


def view_of(options: SynthesizeOptions, motion: Motion) -> View:
    """What the builder of the specimen must know about the images."""
    scale = float(motion.cameras.scale_px_per_unit.min())
    size = np.array([options.width_px, image_rows(options)])
    centre = size * SCENE_DEFAULTS[options.scene].centre
    away = np.abs(motion.cameras.translation_px - centre).max(axis=0)
    half = (np.maximum(centre, size - centre) + away + 2.0) / scale
    half = np.abs(mounting(options)[:2, :2]) @ half
    cosine = motion.cameras.cam_from_world[:, 2, 2].min()
    return View(
        edge=options.mesh_edge_px / nominal_scale(options),
        half_width=float(half[0]),
        half_height=float(half[1]),
        max_tilt_rad=float(np.arccos(np.clip(cosine, -1.0, 1.0))),
    )


def make_motion(options: SynthesizeOptions, rng: np.random.Generator) -> Motion:
    """Draw the motion of a series.

    ``R_i = exp(wobble_i) exp(angle_i axis) M``, M the mounting; the shift of the stage is a random
    walk that is called back to the centre, ``d_i = DRIFT_MEMORY d_(i-1) + noise``.
    """
    defaults = SCENE_DEFAULTS[options.scene]
    nominal = nominal_angles_deg(options)
    num, rows, scale = len(nominal), image_rows(options), nominal_scale(options)
    name = options.rotation_axis or defaults.rotation_axis
    axis = np.eye(3)["xyz".index(name)] + np.radians(options.axis_error_deg) * rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    true = nominal + options.step_error_deg * rng.normal(size=num)
    wobble = rotation_from_vector(np.radians(options.wobble_deg) * rng.normal(size=(num, 3)))
    R = wobble @ rotation_from_vector(np.radians(true)[:, None] * axis) @ mounting(options)
    walk = options.stage_drift_px * rng.normal(size=(num, 2))
    for i in range(1, num):
        walk[i] += DRIFT_MEMORY * walk[i - 1]
    centre = np.array(defaults.centre) * [options.width_px, rows]
    ramp = np.linspace(-0.5, 0.5, num) if num > 1 else np.zeros(1)
    displacement = None
    if options.scene == "clump":
        noise = options.displacement_noise_um * rng.normal(size=num)
        displacement = true / options.degrees_per_um + noise
    pixel = options.pixel_size_um
    return Motion(
        cameras=OrthographicCameras(
            cam_from_world=R,
            scale_px_per_unit=scale * (1.0 + options.magnification_drift * ramp),
            translation_px=centre + walk,
        ),
        nominal_deg=nominal,
        true_deg=true,
        axis=axis,
        unit_um=defaults.unit_um if pixel is None else pixel * scale,
        frame_drift_px=options.frame_drift_px * rng.normal(size=(num, 2)),
        row_jitter_px=options.row_jitter_px * rng.normal(size=(num, rows)),
        psf_px=options.psf_px * (1.0 + 0.1 * rng.normal(size=num)).clip(0.5, 1.5),
        gain=(1.0 + options.gain_change * rng.normal(size=num)).clip(0.5, 1.5),
        displacement_um=displacement,
    )
