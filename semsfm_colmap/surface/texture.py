"""Texture: every face gets the grey values of the image that sees it best.

The mesh is unfolded into an atlas (xatlas). A texel's place on the surface follows from casting a
ray through the flat atlas; its grey value from projecting that place into the face's image, exact
under parallel projection. The image of a face is the one it faces most directly among those that
see its centre, smoothed over neighbouring faces so that seams are few. SEM gains differ between
images: each image is scaled to the grey values that the fused cloud has from all of them.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from semsfm_colmap.surface.halfedges import opposite_halfedge
from semsfm_colmap.surface.open3d_import import import_open3d
from semsfm_colmap.surface.options import SurfaceOptions
from semsfm_colmap.surface.repair import face_normals, vertex_normals
from semsfm_colmap.types import Array, Float, Int, Reconstruction, TriangleMesh

MAX_VIEWS = 36
"""Images that are tried; of longer series so many, evenly."""
GUTTER_PX = 4
"""Texels around each chart that are filled from it, so that filtering does not show seams."""
NO_VIEW = -1


def texture_mesh(
    mesh: TriangleMesh,
    reconstruction: Reconstruction,
    image_path: Path | str,
    options: SurfaceOptions,
) -> TriangleMesh:
    """The mesh with texture coordinates and a texture.

    Parameters
    ----------
    mesh : in the world of the reconstruction; decimated to `max_texture_faces`
    reconstruction : its cameras and image names
    image_path : folder of the prepared images

    Returns
    -------
    TriangleMesh with ``uv`` (F, 3, 2), origin bottom left, and ``texture`` (H, W, 3)
    """
    import xatlas

    mesh = decimate(mesh, options.max_texture_faces)
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    atlas = xatlas.Atlas()
    atlas.add_mesh(vertices.astype(np.float32), faces.astype(np.uint32))
    pack = xatlas.PackOptions()
    pack.resolution = options.texture_size_px
    pack.padding = GUTTER_PX
    pack.create_image = False
    atlas.generate(xatlas.ChartOptions(), pack)
    mapping, flat, uv = atlas[0]
    # xatlas keeps the order of the faces; pages beyond the first do not occur at this resolution
    corners = np.asarray(uv, dtype=np.float64)[flat]
    view = best_views(mesh, reconstruction)
    texture = bake(mesh, corners, view, reconstruction, Path(image_path), options.texture_size_px)
    assert len(flat) == len(faces)
    assert np.array_equal(np.asarray(mapping)[flat], faces)
    return replace(mesh, uv=corners, texture=texture)


def decimate(mesh: TriangleMesh, max_faces: int) -> TriangleMesh:
    """Quadric decimation to at most `max_faces`, vertex colours from the nearest old vertex."""
    if len(mesh.faces) <= max_faces:
        return mesh
    from scipy.spatial import cKDTree

    o3d = import_open3d()
    coarse = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(np.array(mesh.vertices)),
        o3d.utility.Vector3iVector(np.array(mesh.faces, dtype=np.int32)),
    ).simplify_quadric_decimation(max_faces)
    coarse.remove_degenerate_triangles()
    coarse.remove_duplicated_triangles()
    coarse.remove_unreferenced_vertices()
    vertices, faces = np.asarray(coarse.vertices), np.asarray(coarse.triangles).astype(np.int64)
    nearest = np.asarray(cKDTree(mesh.vertices).query(vertices)[1])
    return TriangleMesh(
        vertices=vertices,
        faces=faces,
        vertex_normals=vertex_normals(vertices, faces),
        vertex_colors=None if mesh.vertex_colors is None else mesh.vertex_colors[nearest],
    )


def ray_scene(vertices: Float, faces: Int) -> Any:
    """An open3d scene for ray casting."""
    o3d = import_open3d()
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        o3d.core.Tensor(np.ascontiguousarray(vertices, dtype=np.float32)),
        o3d.core.Tensor(np.ascontiguousarray(faces, dtype=np.uint32)),
    )
    return scene


def best_views(mesh: TriangleMesh, reconstruction: Reconstruction) -> Int:
    """For every face the image that sees it most directly, NO_VIEW where none does: (F,)."""
    o3d = import_open3d()
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    normals = face_normals(vertices, faces)
    centre = vertices[faces].mean(axis=1)
    scene = ray_scene(vertices, faces)
    size = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    M = reconstruction.num_images
    views = np.unique(np.linspace(0, M - 1, min(M, MAX_VIEWS)).round().astype(int))
    direction = reconstruction.cameras.viewing_direction
    score = np.full((len(views), len(faces)), -np.inf)
    for k, i in enumerate(views):
        facing = -normals @ direction[i]
        rows = np.flatnonzero(facing > 0.15)
        xy = reconstruction.cameras.project(centre[rows], np.full(len(rows), i))
        inside = np.all((xy > 1.0) & (xy < reconstruction.image_size_px[i] - 1.0), axis=1)
        rows = rows[inside]
        # step off the surface along the ray, so that the face does not hide itself
        origin = centre[rows] - 1e-3 * size * direction[i]
        rays = np.concatenate([origin, np.tile(-direction[i], (len(rows), 1))], axis=1)
        hidden = scene.test_occlusions(o3d.core.Tensor(rays.astype(np.float32))).numpy()
        score[k, rows[~hidden]] = facing[rows[~hidden]]
    best = np.where(np.isfinite(score.max(axis=0)), views[score.argmax(axis=0)], NO_VIEW)
    return smooth_labels(best.astype(np.int64), score, views, faces)


def smooth_labels(label: Int, score: Float, views: Int, faces: Int, rounds: int = 4) -> Int:
    """Let faces take their neighbours' image where it sees them nearly as well."""
    opposite = opposite_halfedge(faces).reshape(-1, 3)
    neighbour = np.where(opposite >= 0, opposite // 3, -1)
    number = np.full(int(views.max()) + 2, -1)
    number[views] = np.arange(len(views))
    rows = np.arange(len(label))
    for _ in range(rounds):
        around = np.where(neighbour >= 0, label[neighbour], NO_VIEW)
        # two of three neighbours agree
        agreed = np.where(
            around[:, 0] == around[:, 1],
            around[:, 0],
            np.where(around[:, 1] == around[:, 2], around[:, 1], around[:, 2]),
        )
        pairs = (
            (around[:, 0] == around[:, 1])
            | (around[:, 1] == around[:, 2])
            | (around[:, 0] == around[:, 2])
        )
        agreed = np.where(around[:, 0] == around[:, 2], around[:, 0], agreed)
        candidate = number[agreed]
        theirs = np.where(candidate >= 0, score[candidate, rows], -np.inf)
        mine = np.where(label >= 0, score[number[label], rows], -np.inf)
        change = pairs & (agreed >= 0) & (theirs > 0.6 * mine) & np.isfinite(theirs)
        label = np.where(change, agreed, label)
    return label


def bake(
    mesh: TriangleMesh,
    corners: Float,
    view: Int,
    reconstruction: Reconstruction,
    image_path: Path,
    size_px: int,
) -> Array:
    """Grey values of all texels: (size, size, 3) uint8, row 0 at v = 1."""
    import cv2

    o3d = import_open3d()
    F = len(mesh.faces)
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    flat = np.concatenate([corners.reshape(-1, 2), np.zeros((3 * F, 1))], axis=1)
    scene = ray_scene(flat, np.arange(3 * F).reshape(F, 3))
    grid = (np.arange(size_px) + 0.5) / size_px
    texture = np.zeros((size_px, size_px), dtype=np.float32)
    face_of = np.full((size_px, size_px), -1, dtype=np.int64)
    place = np.zeros((size_px, size_px, 3), dtype=np.float32)
    u, v = np.meshgrid(grid, 1.0 - grid)
    rays = np.zeros((size_px, size_px, 6), dtype=np.float32)
    rays[..., 0], rays[..., 1], rays[..., 2], rays[..., 5] = u, v, 1.0, -1.0
    hit = scene.cast_rays(o3d.core.Tensor(rays))
    face = hit["primitive_ids"].numpy().astype(np.int64)
    barycentric = hit["primitive_uvs"].numpy()
    found = face < F
    face_of[found] = face[found]
    b = barycentric[found]
    weights = np.column_stack([1.0 - b.sum(axis=1), b])
    place[found] = np.einsum("tk,tkd->td", weights, vertices[faces[face[found]]])
    if mesh.vertex_colors is not None:
        grey = np.asarray(mesh.vertex_colors, dtype=np.float64)[:, 0]
        texture[found] = np.einsum("tk,tk->t", weights, grey[faces[face[found]]])
    chosen = np.where(face_of >= 0, view[np.maximum(face_of, 0)], NO_VIEW)
    for i in np.unique(chosen[chosen >= 0]):
        data = np.fromfile(image_path / reconstruction.image_names[i], dtype=np.uint8)
        image = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE)
        texels = chosen == i
        xy = reconstruction.cameras.project(
            place[texels].astype(np.float64), np.full(int(texels.sum()), i)
        )
        sample = sample_image(image, xy)
        gain = 1.0
        if mesh.vertex_colors is not None:
            gain = float(np.clip(np.sum(texture[texels]) / max(np.sum(sample), 1.0), 0.5, 2.0))
        texture[texels] = gain * sample
    filled = fill_gutter(np.clip(texture, 0, 255).astype(np.uint8), face_of >= 0)
    return np.repeat(filled[..., None], 3, axis=2)


def sample_image(image: Array | None, xy: Float) -> Float:
    """Bilinear grey values at (T, 2) px, COLMAP's pixel origin: (T,)."""
    from scipy.ndimage import map_coordinates

    if image is None:
        return np.zeros(len(xy))
    # scipy puts the centre of the first pixel at 0
    places = np.stack([xy[:, 1] - 0.5, xy[:, 0] - 0.5])
    return np.asarray(
        map_coordinates(image, places, output=np.float32, order=1, mode="nearest"),
        dtype=np.float64,
    )


def fill_gutter(texture: Array, known: Array) -> Array:
    """Continue the charts a few texels outward: (H, W) uint8, (H, W) bool -> (H, W) uint8."""
    import cv2

    out, have = texture.copy(), known.astype(np.uint8)
    kernel = np.ones((3, 3), np.uint8)
    for _ in range(GUTTER_PX):
        grown = cv2.dilate(np.where(have > 0, out, 0).astype(np.uint8), kernel)
        more = cv2.dilate(have, kernel)
        out = np.where((have == 0) & (more > 0), grown, out).astype(np.uint8)
        have = more
    return out
