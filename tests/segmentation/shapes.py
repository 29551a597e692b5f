"""Clouds in closed form: a ball on a stalk or on a helical ribbon, alone, and on a plate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from semsfm_colmap.geometry.rotations import rotation_from_vector
from semsfm_colmap.types import Float, Int, OrthographicCameras, PointCloud

WIDTH, HEIGHT, SCALE = 200, 160, 40.0
BALL = 1.0
STALK = 0.3
PITCH = 0.5
NOISE = 0.01


@dataclass(frozen=True, kw_only=True, eq=False)
class Shape:
    """A cloud with the truth of it, 1 the specimen, 0 what holds it."""

    cloud: PointCloud
    specimen: Int
    cameras: OrthographicCameras

    @property
    def image_size_px(self) -> Int:
        return np.tile([WIDTH, HEIGHT], (len(self.cameras), 1))


def cameras_about(axis: str, angles_deg: Float) -> OrthographicCameras:
    """Cameras that turn about an image axis."""
    turn = np.radians(angles_deg)[:, None] * np.eye(3)["xyz".index(axis)]
    num = len(angles_deg)
    return OrthographicCameras(
        cam_from_world=rotation_from_vector(turn),
        scale_px_per_unit=np.full(num, SCALE),
        translation_px=np.tile([WIDTH / 2, HEIGHT / 2], (num, 1)),
    )


def ball(num: int, rng: np.random.Generator, radius: float = BALL) -> tuple[Float, Float]:
    """Points and normals of a ball about the origin."""
    n = rng.normal(size=(num, 3))
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    return radius * n, n


def tube(num: int, rng: np.random.Generator, start: float, end: float) -> tuple[Float, Float]:
    """A cylinder about y."""
    phi, y = rng.uniform(0, 2 * np.pi, num), rng.uniform(start, end, num)
    n = np.stack([np.cos(phi), np.zeros(num), np.sin(phi)], axis=1)
    return STALK * n + y[:, None] * [0.0, 1.0, 0.0], n


def ribbon(num: int, rng: np.random.Generator, start: float, end: float) -> tuple[Float, Float]:
    """Both sides of a thin strip wound on that cylinder, covering half of each turn."""
    points, n = tube(4 * num, rng, start, end)
    phase = (np.arctan2(n[:, 2], n[:, 0]) / (2 * np.pi) - points[:, 1] / PITCH) % 1.0
    on = np.flatnonzero(phase < 0.5)[:num]
    side = rng.choice([-1.0, 1.0], len(on))[:, None]
    return points[on] + 0.01 * side * n[on], side * n[on]


def made(
    parts: list[tuple[Float, Float]],
    specimen: list[int],
    cameras: OrthographicCameras,
    rng: np.random.Generator,
) -> Shape:
    """The parts in one cloud, with noise along the normals; what no image shows is left out."""
    points, normals = (np.concatenate([part[k] for part in parts]) for k in (0, 1))
    label = np.repeat(specimen, [len(part[0]) for part in parts])
    points = points + NOISE * rng.normal(size=(len(points), 1)) * normals
    uv = np.einsum("mij,nj->mni", cameras.projection, points) + cameras.translation_px[:, None]
    inside = np.all((uv >= 0) & (uv < [WIDTH, HEIGHT]), axis=2).mean(axis=0) > 0.5
    return Shape(
        cloud=PointCloud(points=points[inside], normals=normals[inside]),
        specimen=label[inside],
        cameras=cameras,
    )


def held_ball(holder: str, seed: int = 0) -> Shape:
    """A ball held from below, by a "stalk" or a "ribbon", turned all round about y."""
    rng = np.random.default_rng(seed)
    body = ball(9000, rng)
    keep = ~((np.hypot(body[0][:, 0], body[0][:, 2]) < STALK) & (body[0][:, 1] > 0))
    body = body[0][keep], body[1][keep]
    start = float(np.sqrt(BALL**2 - STALK**2))
    part = {"stalk": tube, "ribbon": ribbon}[holder](3000, rng, start, 4.0)
    return made([body, part], [1, 0], cameras_about("y", np.arange(0.0, 360.0, 15.0)), rng)


def free_ball(radius: float = BALL, offset: Float | None = None, seed: int = 0) -> Shape:
    """A ball that nothing holds, turned about y."""
    rng = np.random.default_rng(seed)
    points, normals = ball(9000, rng, radius)
    points = points + (np.zeros(3) if offset is None else offset)
    return made([(points, normals)], [1], cameras_about("y", np.arange(0.0, 360.0, 15.0)), rng)


def plate(num: int, rng: np.random.Generator, relief: float = 0.0) -> tuple[Float, Float]:
    """A plate across the view that fills the frame; z is away from the viewer."""
    x, y = rng.uniform(-3.5, 3.5, num), rng.uniform(-3.0, 3.0, num)
    z = relief * np.sin(4.0 * x) * np.cos(3.0 * y)
    slope = np.stack(
        [
            4.0 * relief * np.cos(4.0 * x) * np.cos(3.0 * y),
            -3.0 * relief * np.sin(4.0 * x) * np.sin(3.0 * y),
            np.full(num, -1.0),
        ],
        axis=1,
    )
    return np.stack([x, y, z], axis=1), slope / np.linalg.norm(slope, axis=1, keepdims=True)


def ball_on_plate(seed: int = 0) -> Shape:
    """The upper half of a ball on a plate, tilted about x over 12 degrees."""
    rng = np.random.default_rng(seed)
    body = ball(9000, rng)
    upper = body[0][:, 2] < 0
    ground = plate(12000, rng)
    beside = np.hypot(ground[0][:, 0], ground[0][:, 1]) > BALL
    parts = [(body[0][upper], body[1][upper]), (ground[0][beside], ground[1][beside])]
    return made(parts, [1, 0], cameras_about("x", np.linspace(-6.0, 6.0, 5)), rng)


def rough_field(seed: int = 0) -> Shape:
    """A field with relief that fills the frame."""
    rng = np.random.default_rng(seed)
    cameras = cameras_about("x", np.linspace(-20.0, 20.0, 9))
    return made([plate(20000, rng, relief=0.25)], [1], cameras, rng)


def ball_on_half_a_plate(seed: int = 0) -> Shape:
    """The same where stereo saw the plate on the left alone, and a hair over the upper border."""
    whole = ball_on_plate(seed)
    points, normals = np.asarray(whole.cloud.points), np.asarray(whole.cloud.normals)
    keep = (whole.specimen == 1) | (points[:, 0] < -0.3)
    rng = np.random.default_rng(seed)
    y = rng.uniform(-2.0, -0.9, 200)
    hair = np.stack([0.02 * rng.normal(size=200), y, np.full(200, -0.5)], axis=1)
    return Shape(
        cloud=PointCloud(
            points=np.concatenate([points[keep], hair]),
            normals=np.concatenate([normals[keep], np.tile([0.0, 0.0, -1.0], (200, 1))]),
        ),
        specimen=np.concatenate([whole.specimen[keep], np.ones(200, dtype=np.int64)]),
        cameras=whole.cameras,
    )
