"""A small series with truth, and reconstructions of it: right, moved, or wrong on purpose."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from semsfm_colmap.evaluation import Truth
from semsfm_colmap.geometry.alignment import Similarity, depth_reversed_cameras
from semsfm_colmap.geometry.rotations import MIRROR_Z, rotation_from_vector
from semsfm_colmap.synthetic.primitives import geodesic_sphere
from semsfm_colmap.types import (
    Float,
    Observations,
    OrthographicCameras,
    Reconstruction,
    TriangleMesh,
)

UNIT_UM = 12.0
SCALE = 100.0
SIZE = (400, 300)
WORLD = Similarity(
    rotation=rotation_from_vector(np.array([0.7, -0.4, 1.9])),
    scale=UNIT_UM,
    shift=np.array([5.0, -3.0, 40.0]),
)
"""From the scene of the truth to the world of a reconstruction in um."""


def bumpy_ball() -> TriangleMesh:
    """A ball with a few broad bumps: no symmetry that would hide a wrong hand."""
    d, faces = geodesic_sphere(24)
    height = 0.2 * np.sin(3.0 * d[:, 0] + 1.0) * np.cos(2.0 * d[:, 1]) + 0.15 * d[:, 2] * d[:, 0]
    return TriangleMesh(vertices=d * (1.0 + height)[:, None], faces=faces)


def make_truth(
    num: int = 12, range_deg: float = 90.0, mesh: TriangleMesh | None = None, seed: int = 0
) -> Truth:
    """A turn about y with some wobble, seen with a magnification that drifts a little."""
    rng = np.random.default_rng(seed)
    angle = np.linspace(0.0, range_deg, num)
    wobble = rotation_from_vector(0.01 * rng.normal(size=(num, 3)))
    turn = rotation_from_vector(np.radians(angle)[:, None] * [0.0, 1.0, 0.0])
    return Truth(
        path=Path("series"),
        names=tuple(f"ball_{i:03d}.png" for i in range(num)),
        cameras=OrthographicCameras(
            cam_from_world=wobble @ turn,
            scale_px_per_unit=SCALE * (1.0 + 1e-3 * np.linspace(-0.5, 0.5, num)),
            translation_px=np.array([200.0, 150.0]) + 5.0 * rng.normal(size=(num, 2)),
        ),
        image_size_px=SIZE,
        unit_um=UNIT_UM,
        true_deg=angle,
        axis=np.array([0.0, 1.0, 0.0]),
        mesh=mesh,
    )


def write_truth(path: Path, truth: Truth) -> None:
    """The files that `load_truth` reads."""
    c = truth.cameras
    content = {
        "image_area": [0, 0, *truth.image_size_px],
        "K2": c.K2.tolist(),
        "rotation_axis_cam": truth.axis.tolist(),
        "unit_um": truth.unit_um,
        "frames": [
            {
                "name": name,
                "true_deg": truth.true_deg[i],
                "R": c.cam_from_world[i].tolist(),
                "t": c.translation_px[i].tolist(),
                "scale": c.scale_px_per_unit[i],
            }
            for i, name in enumerate(truth.names)
        ],
    }
    path.mkdir(parents=True, exist_ok=True)
    (path / "truth.json").write_text(json.dumps(content))
    if truth.mesh is not None:
        np.savez(path / "mesh.npz", vertices=truth.mesh.vertices, faces=truth.mesh.faces)


def moved(cameras: OrthographicCameras, world: Similarity) -> OrthographicCameras:
    """The same cameras for points ``world.apply(X)`` instead of X."""
    back = world.inverse
    shift = np.einsum("mij,j->mi", cameras.projection, back.shift)
    return replace(
        cameras,
        cam_from_world=cameras.cam_from_world @ back.rotation,
        scale_px_per_unit=cameras.scale_px_per_unit * back.scale,
        translation_px=cameras.translation_px + shift,
    )


def reconstruction_of(
    truth: Truth,
    points: Float,
    *,
    world: Similarity = WORLD,
    rotation_noise_rad: float = 0.0,
    pixel_noise_px: float = 0.0,
    seed: int = 1,
) -> Reconstruction:
    """A reconstruction of scene `points` seen in every image, in another world, in um."""
    rng = np.random.default_rng(seed)
    M, N = len(truth.names), len(points)
    track, image = np.divmod(np.arange(M * N), M)
    xy = truth.cameras.project(points[track], image)
    xy = xy + pixel_noise_px * rng.normal(size=xy.shape)
    noise = rotation_from_vector(rotation_noise_rad * rng.normal(size=(M, 3)))
    # The noise turns about the origin of the scene, whatever the world is.
    noisy = replace(truth.cameras, cam_from_world=noise @ truth.cameras.cam_from_world)
    return Reconstruction(
        image_names=truth.names,
        image_size_px=np.tile(truth.image_size_px, (M, 1)),
        cameras=moved(noisy, world),
        points=world.apply(points),
        observations=Observations(
            image_idx=image,
            track_idx=track,
            keypoint_idx=track,
            xy=xy,
            num_images=M,
            num_tracks=N,
        ),
        inlier=np.ones(M * N, dtype=bool),
        world_unit="um",
        pixel_size_um=truth.pixel_size_um,
    )


def mirrored(reconstruction: Reconstruction) -> Reconstruction:
    """The depth-reversed twin: the same images from the other hand."""
    return replace(
        reconstruction,
        cameras=depth_reversed_cameras(reconstruction.cameras),
        points=reconstruction.points @ MIRROR_Z,
    )
