"""Simulated tracks with true occlusion, and the model a reconstruction would make of them.

A ray from each surface point toward the viewer decides whether the surface hides it. A visible
point is detected with a probability that falls with foreshortening, that differs between points
and may prefer ridges or grooves, and its track breaks at a rate per degree of turn, as descriptors
change. Keypoints carry noise and a displacement along the surface's slope that turns with the view
(shading). Some observations are wrong: the point is not there at all.

The model is what bundle adjustment would hand on: cameras with small errors of rotation and of the
total tilt, points triangulated with them, observations within the last threshold. What the solver
would do to the points is in it; its own errors in the angles are drawn, not computed, which makes
one scene cost a tenth of a second.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from semsfm_colmap.geometry.mesh_normals import face_normals
from semsfm_colmap.geometry.points import residuals, solve_points, track_pointer
from semsfm_colmap.geometry.rotations import rotation_from_vector
from semsfm_colmap.io.open3d_rays import ray_scene, ray_tensor
from semsfm_colmap.synthetic.light_shapes import Shape, build_shape
from semsfm_colmap.synthetic.primitives import Mesh
from semsfm_colmap.types import Bool, Float, Int, Observations, OrthographicCameras

IMAGE_PX = 1000
HALF_IMAGE = 1.25
"""Half the width of the image in units of a body's radius: most leave a margin, not long spines."""
RAY_LIFT = 2e-3
"""Start of the rays above the surface, in radii: a twentieth of a triangle's edge."""
MARGIN_PX = 8
"""Detectors find nothing so near the border of the image."""


@dataclass(frozen=True, kw_only=True)
class OccludedTracksOptions:
    """One scene: what is seen, how it is turned, and what goes wrong."""

    shape: Shape = "bumpy"
    """Kind of specimen."""
    num_images: int = 24
    """Images, evenly over the range."""
    range_deg: float = 90.0
    """Angle between the first and the last image."""
    num_points: int = 4000
    """Points on the surface that may be detected."""
    detection: float = 0.6
    """Probability that a visible point that faces the viewer is detected."""
    limit_deg: float = 72.0
    """Foreshortening at which nothing is detected any more."""
    ridge_preference: float = 0.0
    """Change of log odds of detection per standard deviation of the height above the surroundings:
    negative where features sit in grooves."""
    track_length_deg: float = 18.0
    """Mean turn after which a track breaks."""
    noise_px: float = 0.3
    """Standard deviation of keypoints."""
    shading_px: float = 1.0
    """Displacement of a keypoint on a slope of 90 degrees, downhill."""
    wrong_share: float = 0.01
    """Wrong observations, as a share of the right ones."""
    rotation_error_deg: float = 0.1
    """Error of each camera."""
    tilt_error: float = 0.01
    """Relative error of all angles of turn."""
    wobble_deg: float = 1.0
    """Departure of the true cameras from a turn about one axis."""


@dataclass(frozen=True, kw_only=True, eq=False)
class OccludedScene:
    """A model with the right hand, its inlier observations, and the truth behind them."""

    cameras: OrthographicCameras
    points: Float
    observations: Observations
    image_size_px: Int
    true_cameras: OrthographicCameras
    true_angle_rad: Float
    """(M,) turn about `axis`"""
    axis: Float
    """(3,) in the camera frame; right-handed turn of the specimen, x right, y down, z away"""
    raw: Observations
    """before triangulation: what `map_observations` takes"""


def simulate_occluded(options: OccludedTracksOptions, rng: np.random.Generator) -> OccludedScene:
    """Draw one scene."""
    true, angle, axis = _turn(options, rng)
    tilt = float(np.arccos(np.clip(true.cam_from_world[:, 2, 2].min(), 0.35, 1.0)))
    mesh = build_shape(options.shape, HALF_IMAGE / np.cos(tilt) + 0.2, rng)
    points, normals, height = _sample(mesh, options.num_points, rng)
    visible = _visible(mesh, points, normals, true)
    inside = _inside(true, points)
    detected = _detect(options, true, normals, height, visible & inside, rng)
    raw = _tracks(options, true, points, normals, detected, inside, angle, rng)
    size = np.full((options.num_images, 2), IMAGE_PX)
    cameras = _disturbed(options, true, angle, axis, rng)
    X, kept = _triangulated(cameras, raw, max(2.0, 4.0 * options.noise_px))
    return OccludedScene(
        cameras=cameras,
        points=X,
        observations=kept,
        image_size_px=size,
        true_cameras=true,
        true_angle_rad=angle,
        axis=axis,
        raw=raw,
    )


def noise_scene(num_images: int, num_tracks: int, rng: np.random.Generator) -> OccludedScene:
    """A model made of nothing: random cameras, random tracks, points fitted to them."""
    options = OccludedTracksOptions(
        num_images=num_images, range_deg=float(rng.uniform(10, 360)), wobble_deg=5.0
    )
    true, angle, axis = _turn(options, rng)
    length = rng.integers(3, max(4, num_images // 2) + 1, num_tracks)
    rows = [np.sort(rng.choice(num_images, size=min(n, num_images), replace=False)) for n in length]
    image_idx = np.concatenate(rows)
    track_idx = np.repeat(np.arange(num_tracks), [len(r) for r in rows])
    cloud = rng.normal(size=(num_tracks, 3)) * rng.uniform(0.1, 0.5, 3)
    xy = true.project(cloud[track_idx], image_idx) + rng.normal(size=(len(image_idx), 2))
    raw = _observations(image_idx, track_idx, xy, num_images)
    cameras = replace(
        true,
        cam_from_world=rotation_from_vector(0.002 * rng.normal(size=(num_images, 3)))
        @ true.cam_from_world,
    )
    X, kept = _triangulated(cameras, raw, 4.0)
    return OccludedScene(
        cameras=cameras,
        points=X,
        observations=kept,
        image_size_px=np.full((num_images, 2), IMAGE_PX),
        true_cameras=true,
        true_angle_rad=angle,
        axis=axis,
        raw=raw,
    )


def _turn(
    options: OccludedTracksOptions, rng: np.random.Generator
) -> tuple[OrthographicCameras, Float, Float]:
    """Cameras of a turn about an axis in the image plane, angles centred for small ranges."""
    M = options.num_images
    half = np.radians(options.range_deg) / 2.0
    angle = np.linspace(-half, half, M)
    direction = rng.uniform(0.0, 2.0 * np.pi)
    axis = np.array([np.cos(direction), np.sin(direction), 0.05 * rng.normal()])
    axis /= np.linalg.norm(axis)
    wobble = rotation_from_vector(np.radians(options.wobble_deg) * rng.normal(size=(M, 3)))
    return (
        OrthographicCameras(
            cam_from_world=wobble @ rotation_from_vector(angle[:, None] * axis),
            scale_px_per_unit=IMAGE_PX / (2.0 * HALF_IMAGE) * np.exp(5e-4 * rng.normal(size=M)),
            translation_px=IMAGE_PX / 2.0 + 10.0 * rng.normal(size=(M, 2)),
        ),
        angle,
        axis,
    )


def _sample(mesh: Mesh, num: int, rng: np.random.Generator) -> tuple[Float, Float, Float]:
    """Points spread by area, unit normals, and standardised height above the surroundings."""
    from scipy.spatial import cKDTree

    vertices, faces = mesh
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normal = face_normals(vertices, faces)
    area = np.linalg.norm(normal, axis=1)
    pick = rng.choice(len(faces), size=num, p=area / area.sum())
    u, v = rng.random((2, num))
    flip = u + v > 1.0
    u, v = np.where(flip, 1.0 - u, u)[:, None], np.where(flip, 1.0 - v, v)[:, None]
    points = a[pick] + u * (b - a)[pick] + v * (c - a)[pick]
    normals = normal[pick] / area[pick, None]
    nearest = cKDTree(points).query(points, k=min(20, num))[1]
    height = np.sum((points - points[nearest].mean(axis=1)) * normals, axis=1)
    return points, normals, (height - height.mean()) / (height.std() + 1e-12)


def _visible(mesh: Mesh, points: Float, normals: Float, cameras: OrthographicCameras) -> Bool:
    """(M, N): faces the viewer, and nothing lies between."""
    scene = ray_scene(*mesh)
    visible = np.zeros((len(cameras), len(points)), dtype=bool)
    for i, direction in enumerate(cameras.viewing_direction):
        front = np.flatnonzero(normals @ direction < 0.0)
        start = points[front] - RAY_LIFT * direction
        rays = ray_tensor(start, -direction)
        visible[i, front] = ~scene.test_occlusions(rays).numpy()
    return visible


def _inside(cameras: OrthographicCameras, points: Float) -> Bool:
    xy = np.einsum("mij,nj->mni", cameras.projection, points) + cameras.translation_px[:, None]
    return np.asarray(np.all((xy > MARGIN_PX) & (xy < IMAGE_PX - MARGIN_PX), axis=2))


def _detect(
    options: OccludedTracksOptions,
    cameras: OrthographicCameras,
    normals: Float,
    height: Float,
    visible: Bool,
    rng: np.random.Generator,
) -> Bool:
    """(M, N) detections: odds by point and foreshortening."""
    cosine = -cameras.viewing_direction @ normals.T
    limit = np.cos(np.radians(options.limit_deg))
    facing = np.clip((cosine - limit) / (1.0 - limit), 0.0, 1.0) ** 0.5
    base = np.log(options.detection / (1.0 - options.detection))
    logit = base + options.ridge_preference * height + rng.normal(size=len(normals))
    probability = facing / (1.0 + np.exp(-logit))
    return np.asarray(visible & (rng.random(visible.shape) < probability))


def _tracks(
    options: OccludedTracksOptions,
    cameras: OrthographicCameras,
    points: Float,
    normals: Float,
    detected: Bool,
    inside: Bool,
    angle: Float,
    rng: np.random.Generator,
) -> Observations:
    """Detections cut where the tracks break, and measured; tracks of three and more are kept."""
    M, N = detected.shape
    step = np.degrees(np.abs(np.diff(angle, prepend=angle[0])))
    broken = rng.random((M, N)) < 1.0 - np.exp(-step[:, None] / options.track_length_deg)
    piece = np.cumsum(broken, axis=0)
    image_idx, point = np.nonzero(detected)
    key = point * (M + 1) + piece[image_idx, point]
    _, number, count = np.unique(key, return_inverse=True, return_counts=True)
    long = count[number] >= 3
    image_idx, point, key = image_idx[long], point[long], key[long]
    # wrong ones: a track claims to be seen where it may be anywhere, within the threshold
    num_wrong = int(options.wrong_share * len(key))
    if num_wrong:
        of = rng.integers(0, len(key), num_wrong)
        where = rng.integers(0, M, num_wrong)
        fits = inside[where, point[of]]
        image_idx = np.concatenate([image_idx, where[fits]])
        key = np.concatenate([key, key[of[fits]]])
        point = np.concatenate([point, point[of[fits]]])
    right = len(key) - (int(fits.sum()) if num_wrong else 0)
    order = np.lexsort((np.arange(len(key)), image_idx, key))
    first = np.ones(len(order), dtype=bool)
    first[1:] = (np.diff(key[order]) != 0) | (np.diff(image_idx[order]) != 0)
    order = order[first]
    xy = cameras.project(points[point[order]], image_idx[order])
    slope = np.einsum(
        "oij,oj->oi", cameras.cam_from_world[image_idx[order], :2], normals[point[order]]
    )
    xy += options.shading_px * slope * np.linalg.norm(slope, axis=1, keepdims=True)
    wrong = order >= right
    xy += np.where(wrong, 3.0, 1.0)[:, None] * options.noise_px * rng.normal(size=xy.shape)
    track = np.unique(key[order], return_inverse=True)[1]
    return _observations(image_idx[order], track, xy, M)


def _observations(image_idx: Int, track_idx: Int, xy: Float, num_images: int) -> Observations:
    return Observations(
        image_idx=image_idx,
        track_idx=track_idx,
        keypoint_idx=np.arange(len(track_idx)),
        xy=xy,
        num_images=num_images,
        num_tracks=int(track_idx.max()) + 1 if len(track_idx) else 0,
    )


def _disturbed(
    options: OccludedTracksOptions,
    true: OrthographicCameras,
    angle: Float,
    axis: Float,
    rng: np.random.Generator,
) -> OrthographicCameras:
    """The cameras as estimated: each off a little, all angles off by one factor."""
    error = np.radians(options.rotation_error_deg) * rng.normal(size=(len(true), 3))
    stretch = rotation_from_vector(options.tilt_error * rng.normal() * angle[:, None] * axis)
    return replace(true, cam_from_world=rotation_from_vector(error) @ stretch @ true.cam_from_world)


def _triangulated(
    cameras: OrthographicCameras, raw: Observations, threshold_px: float
) -> tuple[Float, Observations]:
    """Points of the tracks and the observations that agree with them; the rest is left out."""
    obs = raw
    for _ in range(2):
        pointer = track_pointer(obs.track_idx, obs.num_tracks)
        A, t = np.ascontiguousarray(cameras.projection), np.array(cameras.translation_px)
        X = solve_points(
            A, t, obs.image_idx, pointer, np.ascontiguousarray(obs.xy), np.ones(len(obs))
        )
        r = residuals(A, t, X, obs.image_idx, obs.track_idx, obs.xy)
        good = np.linalg.norm(r, axis=1) < threshold_px  # nan is not
        good &= np.bincount(obs.track_idx[good], minlength=obs.num_tracks)[obs.track_idx] >= 3
        obs = obs.select(good)
    used, track_idx = np.unique(obs.track_idx, return_inverse=True)
    return X[used], replace(obs, track_idx=track_idx, num_tracks=len(used))
