"""What a perfect stereo would see of a synthetic specimen: an oriented cloud with true labels.

Points lie evenly on the surface, at most one a cell of a grid. One that is seen by at least
`MIN_VIEWS` of the images, inside of their frames, without anything before it and less than
`MAX_SLANT_DEG` from facing them, is kept and displaced along its normal by Gaussian noise. For
tests and tables of what works on clouds, at a hundredth of the time that images and stereo take.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from semsfm_colmap.geometry.mesh_normals import vertex_normals
from semsfm_colmap.io.open3d_rays import ray_scene, ray_tensor
from semsfm_colmap.synthetic.motion import image_rows, make_motion, random_streams, view_of
from semsfm_colmap.synthetic.options import SynthesizeOptions
from semsfm_colmap.synthetic.scenes import build_specimen
from semsfm_colmap.synthetic.scenes.base import SUPPORT, Specimen
from semsfm_colmap.types import Float, Int, OrthographicCameras, PointCloud

MIN_VIEWS = 3
MAX_SLANT_DEG = 75.0
LIFT_PX = 1.0
"""Start of a ray above its surface."""


@dataclass(frozen=True, kw_only=True, eq=False)
class VisibleCloud:
    """N points that M images see."""

    cloud: PointCloud
    label: Int
    """(N,) SPECIMEN or SUPPORT of `scenes.base`"""
    cameras: OrthographicCameras
    image_size_px: Int
    """(M, 2)"""


def visible_cloud(
    options: SynthesizeOptions, *, spacing_px: float = 2.0, sigma_px: float = 0.5
) -> VisibleCloud:
    """The cloud of a scene and a seed; scene units.

    Parameters
    ----------
    options : scene, seed, size and number of the images; what only a picture shows is not used
    spacing_px : of the points
    sigma_px : of the noise along the normals

    """
    # the streams of `synthesize`, so that the same seed is the same specimen
    motion_rng, specimen_rng, _, noise_rng = random_streams(options)
    motion = make_motion(options, motion_rng)
    specimen = build_specimen(options.scene, view_of(options, motion), specimen_rng)
    scale = float(motion.cameras.scale_px_per_unit.mean())
    size = np.array([options.width_px, image_rows(options)])
    normals = _outward(specimen)
    rows = _thinned(specimen.vertices, normals, spacing_px / scale)
    points, normals = specimen.vertices[rows], normals[rows]
    views = _num_views(points, normals, motion.cameras, size, specimen.vertices, specimen.faces)
    seen = views >= MIN_VIEWS
    noise = sigma_px / scale * noise_rng.normal(size=(int(seen.sum()), 1))
    return VisibleCloud(
        cloud=PointCloud(points=points[seen] + noise * normals[seen], normals=normals[seen]),
        label=np.asarray(specimen.label[rows][seen], dtype=np.int64),
        cameras=motion.cameras,
        image_size_px=np.tile(size, (len(motion.cameras), 1)),
    )


def _outward(specimen: Specimen) -> Float:
    """Vertex normals that leave the body: those of a part with a negative volume are turned."""
    normals = vertex_normals(specimen.vertices, specimen.faces)
    corner = specimen.vertices[specimen.faces]
    volume = np.einsum("fi,fi->f", corner[:, 0], np.cross(corner[:, 1], corner[:, 2]))
    for part in np.unique(specimen.label):
        closed = part == SUPPORT or (specimen.label == SUPPORT).any()
        mine = specimen.label[specimen.faces[:, 0]] == part
        if closed and volume[mine].sum() < 0:
            normals[specimen.label == part] *= -1.0
    return normals


def _thinned(points: Float, normals: Float, size: float) -> Int:
    """One vertex for each occupied cell and octant of its normal: the sides of a sheet are two."""
    cell = np.floor((points - points.min(axis=0)) / size).astype(np.int64)
    octant = (normals > 0) @ np.array([1, 2, 4])
    _, first = np.unique(np.column_stack([cell, octant]), axis=0, return_index=True)
    return np.asarray(first, dtype=np.int64)


def _num_views(
    points: Float,
    normals: Float,
    cameras: OrthographicCameras,
    size: Int,
    vertices: Float,
    faces: Int,
) -> Int:
    scene = ray_scene(vertices, faces)
    start = points + LIFT_PX / float(cameras.scale_px_per_unit.mean()) * normals
    count = np.zeros(len(points), dtype=np.int64)
    for i in range(len(cameras)):
        toward = -cameras.viewing_direction[i]
        uv = points @ cameras.projection[i].T + cameras.translation_px[i]
        facing = np.all((uv >= 0) & (uv < size), axis=1)
        facing &= normals @ toward > np.cos(np.radians(MAX_SLANT_DEG))
        where = np.flatnonzero(facing)
        free = ~scene.test_occlusions(ray_tensor(start[where], toward)).numpy()
        count[where[free]] += 1
    return count
