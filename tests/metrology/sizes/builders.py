"""Places, meshes and models with known answers."""

from __future__ import annotations

import numpy as np

from semsfm_colmap.geometry.points import solve_points, track_pointer
from semsfm_colmap.metrology.sizes.places import Places
from semsfm_colmap.synthetic.primitives import geodesic_sphere, grid_faces
from semsfm_colmap.synthetic.tracks import simulate_tracks
from semsfm_colmap.types import Float, Int, Reconstruction, TriangleMesh

RADIUS_PX = 300.0


def places_at(points: Float, normals: Float | None = None, num_images: int = 4) -> Places:
    """Vertices that all images see, with a sigma of 1."""
    points = np.atleast_2d(np.asarray(points, dtype=np.float64))
    K = len(points)
    if normals is None:
        normals = np.tile([0.0, 0.0, -1.0], (K, 1))
    return Places(
        points=points,
        normals=np.asarray(normals, dtype=np.float64),
        weights=np.ones((K, num_images)),
        sigma=np.ones(K),
        image=np.full(K, -1, dtype=np.int64),
        track=np.zeros(K, dtype=bool),
        scatter=np.full(K, np.nan),
    )


def simulated_model(seed: int = 3, num_images: int = 9, noise_px: float = 0.3) -> Reconstruction:
    """A model as mapping leaves it: true cameras, points that suit their noisy observations."""
    simulated = simulate_tracks(
        num_images=num_images, range_deg=60.0, num_tracks=400, noise_px=noise_px, body="body",
        radius_px=RADIUS_PX, wobble_deg=0.5, rng=np.random.default_rng(seed),
    )  # fmt: skip
    obs = simulated.observations
    pointer = track_pointer(obs.track_idx, obs.num_tracks)
    A, t = simulated.cameras.projection, np.asarray(simulated.cameras.translation_px)
    points = solve_points(A, t, obs.image_idx, pointer, obs.xy, np.ones(len(obs)))
    return Reconstruction(
        image_names=tuple(f"im_{i}.tif" for i in range(num_images)),
        image_size_px=np.tile([1000, 1000], (num_images, 1)),
        cameras=simulated.cameras,
        points=points,
        observations=obs,
        inlier=np.ones(len(obs), dtype=bool),
    )


def ball(radius: float = RADIUS_PX, segments: int = 24, sigma: float = 0.8) -> TriangleMesh:
    """A closed sphere about the origin."""
    d, faces = geodesic_sphere(segments)
    return TriangleMesh(
        vertices=radius * d,
        faces=faces,
        vertex_normals=d,
        vertex_sigma=np.full(len(d), sigma),
        face_filled=np.zeros(len(faces), dtype=bool),
    )


def sheet(height: Float, spacing: float = 4.0, sigma: float = 0.8) -> TriangleMesh:
    """A height field (nx, ny) about the origin, seen from -z; nan heights are holes."""
    nx, ny = height.shape
    x = spacing * (np.arange(nx) - (nx - 1) / 2)
    y = spacing * (np.arange(ny) - (ny - 1) / 2)
    X, Y = np.meshgrid(x, y, indexing="ij")
    vertices = np.stack([X, Y, -height], axis=-1).reshape(-1, 3)
    faces: Int = grid_faces(nx, ny)[:, ::-1]
    faces = faces[np.isfinite(vertices[faces]).all(axis=(1, 2))]
    vertices = np.nan_to_num(vertices)
    return TriangleMesh(
        vertices=vertices,
        faces=faces,
        vertex_normals=np.tile([0.0, 0.0, -1.0], (len(vertices), 1)),
        vertex_sigma=np.full(len(vertices), sigma),
    )
