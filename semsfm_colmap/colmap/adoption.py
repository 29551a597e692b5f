"""A model that COLMAP's triangulator or bundle adjuster has changed: compared, then taken or not.

COLMAP may move the world (its bundle adjuster and mapper shift and scale it) and knows nothing of
the sidecar. So the changed model is read as orthographic cameras (`pinhole_reading.py`) and brought
into the old world: the rotation that aligns the camera rotations best, the scale that keeps the
geometric mean magnification (the pixel size is known from the microscope, not from COLMAP), the
shift that keeps the mean of the cameras' translations. What is left is the change.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from semsfm_colmap.colmap.model.pinhole_reading import PinholeReading
from semsfm_colmap.colmap.options import AdoptionOptions
from semsfm_colmap.errors import InputError
from semsfm_colmap.geometry.alignment import Similarity, align_rotations
from semsfm_colmap.geometry.rotations import rotation_angle
from semsfm_colmap.io.names import same_images
from semsfm_colmap.types import Array, Float, OrthographicCameras, Reconstruction


@dataclass(frozen=True, kw_only=True, eq=False)
class ModelChange:
    """What differs, and why the model is refused, if it is."""

    rotation_deg: Float
    """(M,) angle of each camera to its old self"""
    magnification: Float
    """(M,) ratio new / old, geometric mean 1"""
    world_scale: float
    """Size of the changed model's world in the old one's units"""
    num_points: tuple[int, int]
    """old, new"""
    num_observations: tuple[int, int]
    num_common_observations: int
    mean_error_px: tuple[float, float]
    """Orthographic, over the observations both have: old, new"""
    max_deviation_px: float
    reasons: tuple[str, ...] = ()

    @property
    def accepted(self) -> bool:
        """Whether there is no reason against it."""
        return not self.reasons


def fit_world(cameras: OrthographicCameras, old: OrthographicCameras) -> Similarity:
    """The similarity from the world of some cameras to that of other cameras of the same images.

    With ``X_old = g Q^T X + c``: ``R_old = R Q``, ``s_old = s / g`` and ``t_old = t - P_old c``,
    where Q aligns the rotations, g keeps the geometric mean magnification, and c is the least
    squares shift of the translations.
    """
    Q = align_rotations(cameras.cam_from_world, old.cam_from_world)
    log_ratio = np.log(cameras.scale_px_per_unit) - np.log(old.scale_px_per_unit)
    g = float(np.exp(np.mean(log_ratio)))
    rows = _moved(cameras, Q, g, np.zeros(3)).projection.reshape(-1, 3)
    gap = (cameras.translation_px - old.translation_px).reshape(-1)
    shift = np.linalg.lstsq(rows, gap, rcond=None)[0]
    return Similarity(rotation=Q.T, scale=g, shift=np.asarray(shift, dtype=np.float64))


def _moved(cameras: OrthographicCameras, Q: Float, g: float, shift: Float) -> OrthographicCameras:
    turned = replace(
        cameras,
        cam_from_world=cameras.cam_from_world @ Q,
        scale_px_per_unit=cameras.scale_px_per_unit / g,
    )
    return replace(turned, translation_px=cameras.translation_px - turned.projection @ shift)


def align_to(reconstruction: Reconstruction, old: OrthographicCameras) -> Reconstruction:
    """A reconstruction of the same images in the world of other cameras of them."""
    world = fit_world(reconstruction.cameras, old)
    return replace(
        reconstruction,
        cameras=_moved(reconstruction.cameras, world.rotation.T, world.scale, world.shift),
        points=world.apply(reconstruction.points),
    )


def old_origin(old: Reconstruction, reading: PinholeReading) -> Float:
    """The old world's origin in the world of the model read: (3,).

    The old magnifications hold at the depth of this point; read the model again with it as the
    reference, and an unchanged model gives the old cameras.
    """
    world = fit_world(_same_images(old, reading).cameras, old.cameras)
    return np.asarray(world.inverse.apply(np.zeros((1, 3)))[0])


def compare_models(
    old: Reconstruction, old_focal_px: float, reading: PinholeReading, options: AdoptionOptions
) -> tuple[ModelChange, Reconstruction]:
    """The change from `old` to the model read, and that model in the old world.

    Raises
    ------
    InputError
        The two do not show the same images, so there is nothing to compare.

    """
    new = _same_images(old, reading)
    new = align_to(new, old.cameras)
    rotation = np.degrees(
        rotation_angle(new.cameras.cam_from_world @ np.swapaxes(old.cameras.cam_from_world, 1, 2))
    )
    magnification = new.cameras.scale_px_per_unit / old.cameras.scale_px_per_unit
    common_old, common_new = _common_observations(old, new)
    before = np.linalg.norm(old.residuals()[common_old], axis=1)
    after = np.linalg.norm(new.residuals()[common_new], axis=1)
    change = ModelChange(
        rotation_deg=rotation,
        magnification=magnification,
        world_scale=reading.reconstruction.cameras.mean_scale_px_per_unit
        / old.cameras.mean_scale_px_per_unit,
        num_points=(len(old.points), len(new.points)),
        num_observations=(int(old.inlier.sum()), len(new.observations)),
        num_common_observations=len(common_old),
        mean_error_px=(_mean(before), _mean(after)),
        max_deviation_px=reading.max_deviation_px,
    )
    reasons = _reasons(change, old_focal_px, reading, options, old.image_names)
    return replace(change, reasons=reasons), new


def with_names_of(old: Reconstruction, reading: PinholeReading) -> PinholeReading:
    """The same reading with the names that the old model has for its images."""
    known = same_images(old.image_names, tuple(reading.rows))
    new = reading.reconstruction
    names = tuple(known.get(name, name) for name in new.image_names)
    return replace(
        reading,
        reconstruction=replace(new, image_names=names),
        rows={known.get(name, name): row for name, row in reading.rows.items()},
    )


def _mean(values: Float) -> float:
    return float(np.mean(values)) if len(values) else float("nan")


def _same_images(old: Reconstruction, reading: PinholeReading) -> Reconstruction:
    """The model read, its images in the old order and everything else taken from the old one."""
    new = reading.reconstruction
    missing = [name for name in old.image_names if name not in new.image_names]
    extra = [name for name in new.image_names if name not in old.image_names]
    if missing:
        raise InputError(
            f"refused: {len(missing)} of {len(old.image_names)} images are missing from the "
            f"changed model, {missing[0]} for one"
        )
    if extra:
        raise InputError(
            f"refused: the changed model has {len(extra)} images that the project's model lacks, "
            f"{extra[0]} for one"
        )
    position = {name: i for i, name in enumerate(new.image_names)}
    order = np.array([position[name] for name in old.image_names])
    if not np.array_equal(new.image_size_px[order], old.image_size_px):
        raise InputError("refused: the images of the changed model have another size")
    rank = np.argsort(order)
    obs = new.observations
    image_idx = rank[obs.image_idx]
    by_track = np.lexsort((image_idx, obs.track_idx))
    observations = replace(
        obs,
        image_idx=image_idx[by_track],
        track_idx=obs.track_idx[by_track],
        keypoint_idx=obs.keypoint_idx[by_track],
        xy=obs.xy[by_track],
    )
    return replace(
        new,
        image_names=old.image_names,
        image_size_px=old.image_size_px,
        cameras=new.cameras.select(order),
        observations=observations,
        world_unit=old.world_unit,
        pixel_size_um=old.pixel_size_um,
        pixel_size_source=old.pixel_size_source,
        camera_model="scaled_orthographic",
        depth_sign=old.depth_sign,
        gauge=old.gauge,
    )


def _common_observations(old: Reconstruction, new: Reconstruction) -> tuple[Array, Array]:
    """Rows of the observations (image, keypoint) that are inliers of both."""
    rows = np.flatnonzero(old.inlier)
    keys = [
        {(int(i), int(k)): o for o, i, k in zip(index, image, keypoint, strict=True)}
        for index, image, keypoint in (
            (rows, old.observations.image_idx[rows], old.observations.keypoint_idx[rows]),
            (
                np.arange(len(new.observations)),
                new.observations.image_idx,
                new.observations.keypoint_idx,
            ),
        )
    ]
    shared = sorted(keys[0].keys() & keys[1].keys())
    return (
        np.array([keys[0][key] for key in shared], dtype=np.int64),
        np.array([keys[1][key] for key in shared], dtype=np.int64),
    )


def _reasons(
    change: ModelChange,
    old_focal_px: float,
    reading: PinholeReading,
    options: AdoptionOptions,
    names: tuple[str, ...],
) -> tuple[str, ...]:
    reasons: list[str] = []
    focal = reading.focal_length_px
    worst_focal = float(focal.flat[np.argmax(np.abs(focal - old_focal_px))])
    if abs(worst_focal / old_focal_px - 1.0) > options.max_focal_change:
        reasons.append(
            f"the focal length was freed: it is {worst_focal:.6g} px and was {old_focal_px:.6g} px "
            "(run with BundleAdjustment.refine_focal_length 0)"
        )
    worst = int(np.argmax(change.rotation_deg))
    if change.rotation_deg[worst] > options.max_rotation_deg:
        reasons.append(
            f"{names[worst]} turned by {change.rotation_deg[worst]:.3g} degrees, more than "
            f"{options.max_rotation_deg:g}"
        )
    drift = np.abs(np.log(change.magnification))
    worst = int(np.argmax(drift))
    if drift[worst] > options.max_magnification_change:
        reasons.append(
            f"the magnification of {names[worst]} changed by a factor of "
            f"{change.magnification[worst]:.5g} against the others"
        )
    if change.max_deviation_px > options.max_deviation_px:
        reasons.append(
            f"its cameras are {change.max_deviation_px:.3g} px from parallel projection, more than "
            f"{options.max_deviation_px:g} px"
        )
    lost = 1.0 - change.num_common_observations / max(change.num_observations[0], 1)
    if lost > options.max_lost_observations:
        reasons.append(f"{lost:.0%} of the observations are gone")
    before, after = change.mean_error_px
    if change.num_common_observations and after > (1.0 + options.max_error_increase) * before:
        reasons.append(
            f"the same observations fit worse: mean error {after:.3f} px, before {before:.3f} px"
        )
    return tuple(reasons)
