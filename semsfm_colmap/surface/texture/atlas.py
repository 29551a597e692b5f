"""A texture for a mesh: an atlas, and for each texel what the images see of it.

Under parallel projection a triangle maps affinely into each image, so a texel's place follows from
its corners' by barycentric interpolation. An image counts at a vertex when no surface hides it
(one ray). A texel is

    sum_i w_i I_i / sum_i w_i s_i,

the grey that explains the greys I_i seen of it best when their variance grows with the grey, as
that of counted electrons does; s_i is the factor of the shading (`shading.py`). As an albedo, s_i
follows the normal, and all images that see a place count, by the squared cosine of the slant: light
and dark sides go, noise averages out. As an image, s_i is the gain of image i alone, and the
weight falls off quickly from the most frontal image on: few images mix. Weights are continuous over
the mesh either way, so that there are no seams.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from semsfm_colmap.errors import UsageError
from semsfm_colmap.geometry.mesh_normals import vertex_normals
from semsfm_colmap.io.open3d_library import import_open3d
from semsfm_colmap.io.open3d_rays import as_tensor, ray_scene, ray_tensor
from semsfm_colmap.surface.mesh.from_cloud import as_stored
from semsfm_colmap.surface.mesh.repair import welded
from semsfm_colmap.surface.options import SurfaceOptions
from semsfm_colmap.surface.shading import Shading, fit_shading
from semsfm_colmap.surface.stereo.rasters import read_image
from semsfm_colmap.surface.stereo.undrift import drift_of, drifted
from semsfm_colmap.surface.texture.charts import BORDER_TEXELS, make_atlas
from semsfm_colmap.surface.texture.texture_kernels import add_image, rasterize
from semsfm_colmap.types import Array, Float, Reconstruction, TriangleMesh

_MIN_COSINE = 0.1
"""Images that see a vertex at a steeper slant than 84 degrees do not count."""
_SHARPNESS = 12
"""Weight ``(cos / best cos)^12``: half at an image 19 degrees off a frontal one."""
_RAY_START_PX = 2.0
"""Rays start this far above the surface, so that its own noise does not hide it."""
_MAX_PLACES = 20_000
_MAX_OBSERVATIONS = 400_000
"""The shading is fitted to at most so many vertices, and so many greys of them in all."""


def texture_mesh(
    mesh: TriangleMesh,
    reconstruction: Reconstruction,
    image_path: Path | str,
    options: SurfaceOptions,
    *,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[TriangleMesh, Shading]:
    """Reduce a mesh to `options.max_texture_faces` faces and texture it from the images.

    Parameters
    ----------
    mesh : F >= 1 faces, facing outside
    reconstruction : the cameras
    image_path : folder of the prepared images
    options : number of faces, kind and size of the texture
    progress : called after each image

    Returns
    -------
    TriangleMesh with ``uv (F, 3, 2)`` and ``texture (H, W, 3)``; texels that no image sees take
    the vertex colours. The shading: the images are texture times its factors

    """
    if len(mesh.faces) == 0:
        raise UsageError("mesh has no faces: there is nothing to texture.")
    mesh = simplify(mesh, options.max_texture_faces)
    normals = vertex_normals(mesh.vertices, mesh.faces)
    unit = 1.0 / float(np.median(reconstruction.cameras.scale_px_per_unit))
    uv, (width, height) = make_atlas(mesh.vertices, mesh.faces, unit, options.max_texture_size_px)
    texels = uv * [width, height]
    texels[..., 1] = height - texels[..., 1]
    face, bary = rasterize(texels, width, height, BORDER_TEXELS)

    cosine = view_cosines(mesh, reconstruction, _RAY_START_PX * unit)
    weight = cosine**2 if options.texture == "albedo" else frontal_weights(cosine)
    shading = _fit(mesh, normals, weight, reconstruction, Path(image_path), options)
    total = np.zeros((height, width), dtype=np.float32)
    norm = np.zeros((height, width), dtype=np.float32)
    corners = np.ascontiguousarray(mesh.faces)
    for i in range(reconstruction.num_images):
        grey = _grey(reconstruction, Path(image_path), i)
        xy = _seen_at(mesh, reconstruction, i).astype(np.float32)
        factor = shading.factor(i, normals @ reconstruction.cameras.cam_from_world[i].T)
        add_image(face, bary, corners, xy, weight[i], factor.astype(np.float32), grey, total, norm)
        if progress is not None:
            progress(i + 1, reconstruction.num_images)
    seen = norm > 0
    picture = np.where(seen, total / np.maximum(norm, 1e-20), 0.0)
    unseen = (face >= 0) & ~seen
    picture[unseen] = _vertex_grey(mesh, face[unseen], bary[unseen])
    picture[face < 0] = np.median(picture[seen]) if seen.any() else 128.0
    grey8 = np.clip(np.rint(picture), 0, 255).astype(np.uint8)
    return replace(mesh, uv=uv, texture=np.repeat(grey8[..., None], 3, axis=2)), shading


def simplify(mesh: TriangleMesh, max_faces: int) -> TriangleMesh:
    """Quadric decimation (Garland and Heckbert 1997) when there are more than `max_faces` faces."""
    if len(mesh.faces) <= max_faces:
        return mesh
    from scipy.spatial import cKDTree

    middle = mesh.vertices.mean(axis=0)  # float32 below: near the origin
    full = import_open3d().t.geometry.TriangleMesh(
        as_tensor((mesh.vertices - middle).astype(np.float32)),
        as_tensor(mesh.faces.astype(np.int32)),
    )
    small = full.simplify_quadric_decimation(1.0 - max_faces / len(mesh.faces))
    vertices = as_stored(small.vertex.positions.numpy().astype(np.float64) + middle)
    vertices, faces = welded(vertices, small.triangle.indices.numpy().astype(np.int64))
    colors = None
    if mesh.vertex_colors is not None:
        colors = mesh.vertex_colors[cKDTree(mesh.vertices).query(vertices)[1]]
    return TriangleMesh(
        vertices=vertices,
        faces=faces,
        vertex_normals=vertex_normals(vertices, faces),
        vertex_colors=colors,
    )


def view_cosines(mesh: TriangleMesh, reconstruction: Reconstruction, start: float) -> Array:
    """Cosine of the angle between each vertex' normal and each viewer: (M, V) float32.

    Zero where the vertex is outside the image, hidden, or seen at a grazing angle.
    """
    scene = ray_scene(mesh.vertices, mesh.faces)
    normals = vertex_normals(mesh.vertices, mesh.faces)
    direction = reconstruction.cameras.viewing_direction
    cosine = np.zeros((reconstruction.num_images, len(mesh.vertices)), dtype=np.float32)
    for i in range(reconstruction.num_images):
        towards = -normals @ direction[i]
        xy = _seen_at(mesh, reconstruction, i)
        inside = ((xy > 1.0) & (xy < reconstruction.image_size_px[i] - 1.0)).all(axis=1)
        idx = np.flatnonzero(inside & (towards > _MIN_COSINE))
        origin = mesh.vertices[idx] + start * (normals[idx] - direction[i])
        hidden = scene.test_occlusions(ray_tensor(origin, -direction[i])).numpy()
        cosine[i, idx[~hidden]] = towards[idx[~hidden]]
    return cosine


def frontal_weights(cosine: Array) -> Array:
    """``(cos / best cos)^12`` of the images that see a vertex: (M, V) -> (M, V)."""
    best = np.maximum(cosine.max(axis=0), 1e-6)
    weight = (cosine / best) ** _SHARPNESS
    weight[weight < 0.02] = 0.0
    return np.asarray(weight, dtype=np.float32)


def _fit(
    mesh: TriangleMesh,
    normals: Float,
    weight: Array,
    reconstruction: Reconstruction,
    image_path: Path,
    options: SurfaceOptions,
) -> Shading:
    """The shading, from the greys of evenly chosen vertices."""
    import cv2

    num_images = reconstruction.num_images
    num = min(_MAX_PLACES, max(1, _MAX_OBSERVATIONS // num_images), len(mesh.vertices))
    sample = np.linspace(0, len(mesh.vertices) - 1, num).astype(np.int64)
    grey = np.zeros((num_images, num), dtype=np.float32)
    for i in range(num_images):
        image = _grey(reconstruction, image_path, i)
        xy = (_seen_at(mesh, reconstruction, i)[sample] - 0.5).astype(np.float32)
        grey[i] = cv2.remap(image, xy[:, None], None, cv2.INTER_LINEAR)[:, 0]
    normals_cam = None
    if options.texture == "albedo":
        cam_from_world = reconstruction.cameras.cam_from_world
        normals_cam = np.einsum("mij,vj->mvi", cam_from_world, normals[sample])
    return fit_shading(grey, weight[:, sample], normals_cam)


def _grey(reconstruction: Reconstruction, image_path: Path, i: int) -> Array:
    size = (int(reconstruction.image_size_px[i, 0]), int(reconstruction.image_size_px[i, 1]))
    return read_image(image_path / reconstruction.image_names[i], size).astype(np.float32)


def _vertex_grey(mesh: TriangleMesh, face: Array, bary: Array) -> Array:
    """Vertex colours, interpolated, as grey: (n,), (n, 2) -> (n,); 128 without colours."""
    if mesh.vertex_colors is None:
        return np.full(len(face), 128.0)
    grey = mesh.vertex_colors.astype(np.float64).mean(axis=1)[mesh.faces[face]]
    weight = np.column_stack([1.0 - bary.sum(axis=1), bary])
    return np.asarray(np.einsum("nk,nk->n", weight, grey))


def _seen_at(mesh: TriangleMesh, reconstruction: Reconstruction, i: int) -> Float:
    """Where an image shows each vertex, its scan drift included: (V, 2) px."""
    cameras = reconstruction.cameras
    xy = mesh.vertices @ cameras.projection[i].T + cameras.translation_px[i]
    drift = drift_of(reconstruction.drift_px, i)
    return drifted(np.asarray(xy), drift, int(reconstruction.image_size_px[i, 1]))
