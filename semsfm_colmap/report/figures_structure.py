"""The structure as the paper shows it: cameras around the cloud, the mesh with and without texture.

Its figures 16 and 17, 18 and 19. All are parallel projections, equal along all axes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from semsfm_colmap.errors import MissingDependencyError
from semsfm_colmap.geometry.rotations import rotation_from_vector
from semsfm_colmap.report.camera_frames import (
    find_view,
    frame_outlines,
    inside_view,
    labelled_frames,
)
from semsfm_colmap.report.figure_style import GREY, GRID, FigureData, new_figure
from semsfm_colmap.report.images.mesh_view import MeshView
from semsfm_colmap.report.number_text import unit_text
from semsfm_colmap.report.thinning import even_subset, thin_mesh
from semsfm_colmap.types import Array, Float, OrthographicCameras, TriangleMesh

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MAX_POINTS = 12_000
MAX_FACES = 12_000
PIXELS_WIDE = 640
FROM_ABOVE_RAD, FROM_RIGHT_RAD = np.deg2rad(25.0), np.deg2rad(30.0)
"""Where the reader stands relative to the first image."""
NO_MESH = "there is no mesh"


def _boxed(data: FigureData, extent: Float) -> tuple[Figure, Any]:
    """A box of three axes with the world's unit, as wide along each; the first camera's directions.

    Its axes are those of the first image: x right, y down, depth away from the viewer.
    """
    figure = new_figure(6.4, 5.6)
    axes: Any = figure.add_subplot(projection="3d")
    axes.set_proj_type("ortho")
    axes.patch.set_alpha(0.0)
    low, high = extent.min(axis=0), extent.max(axis=0)
    middle, half = 0.5 * (low + high), 0.5 * np.maximum(high - low, 1e-9 * np.max(high - low))
    unit = unit_text(data.inputs.reconstruction.world_unit)
    for k, (letter, name) in enumerate((("x", "x"), ("y", "depth"), ("z", "y"))):
        getattr(axes, f"set_{letter}lim")(middle[k] - half[k], middle[k] + half[k])
        getattr(axes, f"set_{letter}label")(f"{name} [{unit}]", fontsize=9, color=GREY)
        axis = getattr(axes, f"{letter}axis")
        axis.set_pane_color((0.0, 0.0, 0.0, 0.0))
        axis.line.set_color(GREY)
        axis.get_major_locator().set_params(nbins=5)
        axis._axinfo["grid"].update(color=GRID, linewidth=0.6)
    axes.tick_params(labelsize=8, colors=GREY)
    axes.invert_zaxis()
    axes.set_box_aspect(half, zoom=0.92)
    axes.view_init(elev=np.rad2deg(FROM_ABOVE_RAD), azim=-90.0 + np.rad2deg(FROM_RIGHT_RAD))
    return figure, axes


def _in_first_image(data: FigureData, points: Float) -> Float:
    """(P, 3) along the first camera's x, its depth and its y: what stands upright in the box."""
    rec = data.inputs.reconstruction
    R = rec.cameras.cam_from_world[data.frames.image_idx[0]]
    return np.asarray((points @ R.T)[..., [0, 2, 1]])


def camera_trajectory(data: FigureData) -> Figure | str:
    """Figures 16 and 17: the point cloud and the frames of the cameras around it."""
    from mpl_toolkits.mplot3d.art3d import Line3DCollection

    rec, frames = data.inputs.reconstruction, data.frames
    known = rec.track_length() >= 1
    points = rec.points[known]
    if len(points) == 0 or rec.num_images == 0:
        return "there are no points"
    view = find_view(points)
    seen = np.flatnonzero(inside_view(points, view))
    idx = seen[even_subset(len(seen), MAX_POINTS)]
    xyz = _in_first_image(data, points[idx])
    outlines = _in_first_image(data, frame_outlines(rec, view)[frames.image_idx])
    extent = np.concatenate([xyz, outlines.reshape(-1, 3)])
    figure, axes = _boxed(data, extent)
    if rec.point_color is None:
        color: Array = -xyz[:, 1]
    else:
        color = rec.point_color[known][idx] / 255.0
    axes.scatter(*xyz.T, s=1.2, c=color, linewidths=0, depthshade=False)
    lines = Line3DCollection(list(outlines), cmap="turbo", linewidths=0.9)
    lines.set_array(frames.numbers.astype(float))
    axes.add_collection3d(lines)
    for k in labelled_frames(frames.numbers):
        axes.text(*outlines[k, 2], str(frames.numbers[k]), fontsize=8, color=GREY)
    return figure


def _oblique_camera(data: FigureData, mesh: TriangleMesh, width_px: int) -> OrthographicCameras:
    """A camera that looks at the mesh from above and the right of the first image."""
    rec = data.inputs.reconstruction
    turn = rotation_from_vector(np.array([FROM_ABOVE_RAD, 0.0, 0.0])) @ rotation_from_vector(
        np.array([0.0, FROM_RIGHT_RAD, 0.0])
    )
    R = turn @ rec.cameras.cam_from_world[data.frames.image_idx[0]]
    uv = (mesh.vertices @ R.T)[:, :2]
    low, high = uv.min(axis=0), uv.max(axis=0)
    scale = 0.94 * width_px / float(np.max(high - low))
    return OrthographicCameras(
        cam_from_world=R[None],
        scale_px_per_unit=np.array([scale]),
        translation_px=(0.5 * width_px - scale * 0.5 * (low + high))[None],
    )


def textured_structure(data: FigureData) -> Figure | str:
    """Figure 18: the estimated structure, and the same with the texture of the images."""
    mesh = data.inputs.mesh
    if mesh is None or len(mesh.faces) == 0 or data.inputs.reconstruction.num_images == 0:
        return NO_MESH
    camera = _oblique_camera(data, mesh, PIXELS_WIDE)
    try:
        view = MeshView(mesh)
    except MissingDependencyError as error:
        return f"not drawn: {error}"
    hits = view.hits(camera, 0, (PIXELS_WIDE, PIXELS_WIDE), PIXELS_WIDE)
    pictures, texture = [("structure", view.shaded(hits))], view.textured(hits)
    if texture is not None:
        pictures.append(("with texture", texture))
    rows = np.flatnonzero(pictures[0][1][..., 3].any(axis=1))
    if len(rows) == 0:
        return NO_MESH
    shown = slice(rows[0], rows[-1] + 1)
    figure = new_figure(8.0, 0.3 + 4.0 * (rows[-1] + 1 - rows[0]) / PIXELS_WIDE)
    panels = np.ravel(figure.subplots(1, 2))
    for axes in panels:
        axes.set_axis_off()
    for axes, (title, picture) in zip(panels, pictures, strict=False):
        axes.imshow(picture[shown], interpolation="bilinear")
        axes.set_title(title, fontsize=9, loc="left", color=GREY)
    return figure


def meshed_surface(data: FigureData) -> Figure | str:
    """Figure 19: the meshed surface with axes in the world's unit."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    mesh = data.inputs.mesh
    if mesh is None or len(mesh.faces) == 0 or data.inputs.reconstruction.num_images == 0:
        return NO_MESH
    thin = thin_mesh(mesh, MAX_FACES)
    xyz = _in_first_image(data, thin.vertices)
    corner = xyz[thin.faces]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    # the box has y upward negative: light from the upper left, in front
    light = np.array([-0.45, -0.65, -0.6])
    grey = np.clip(0.55 + 0.4 * np.abs(normal @ light) - 0.15, 0.0, 1.0)
    faces = np.column_stack([0.62 * grey, 0.74 * grey, 0.88 * grey])
    inside = inside_view(thin.vertices, find_view(thin.vertices))
    figure, axes = _boxed(data, xyz[inside])
    # edges in the colour of the faces close the seams that antialiasing leaves
    axes.add_collection3d(
        Poly3DCollection(corner, facecolors=faces, edgecolors=faces, linewidths=0.25)
    )
    return figure
