"""The surface in the colours of its error bars, and how they are distributed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from semsfm_colmap.report.camera_frames import find_view, inside_view
from semsfm_colmap.report.figure_style import BLUE, FigureData, color_bar, dress, new_figure
from semsfm_colmap.report.number_text import unit_text
from semsfm_colmap.report.thinning import even_subset
from semsfm_colmap.types import Array, Float

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MAX_POINTS = 60_000
MIN_FACING = 0.1
"""Least cosine between normal and viewer: the far side does not shine through."""
NUM_BINS = 40


def surface_sigma(data: FigureData) -> Figure | str:
    """Standard deviations along the normal, as seen in the middle one of the frames."""
    found = _points(data)
    if found is None:
        return "there is no surface with error bars"
    points, normals, sigma = found
    rec = data.inputs.reconstruction
    middle = int(data.frames.image_idx[len(data.frames.image_idx) // 2])
    R = rec.cameras.cam_from_world[middle]
    view = find_view(points)
    seen = np.flatnonzero(inside_view(points, view) & (-normals @ R[2] > MIN_FACING))
    if len(seen) == 0:
        return "no part of the surface faces the middle frame"
    idx = seen[even_subset(len(seen), MAX_POINTS)]
    uvz = (points[idx] - view.center) @ R.T
    idx, uvz = idx[np.argsort(-uvz[:, 2])], uvz[np.argsort(-uvz[:, 2])]
    low, high = np.percentile(sigma, [2.0, 98.0])
    unit = unit_text(rec.world_unit)
    figure = new_figure(6.4, 6.2)
    picture, histogram = figure.subplots(2, 1, height_ratios=[4.0, 1.0])
    dots = picture.scatter(
        uvz[:, 0], uvz[:, 1], s=1.5, c=sigma[idx], vmin=low, vmax=high, cmap="viridis", linewidths=0
    )
    color_bar(figure, dots, picture, f"σ along the normal [{unit}]")
    picture.set_aspect("equal")
    picture.invert_yaxis()
    dress(picture, xlabel=f"[{unit}]", ylabel=f"[{unit}]", title="error bars of the surface")
    edges = np.linspace(0.0, np.percentile(sigma, 99.5), NUM_BINS + 1)
    histogram.hist(sigma, bins=list(edges), color=BLUE)
    dress(histogram, xlabel=f"σ along the normal [{unit}]", ylabel="vertices")
    return figure


def _points(data: FigureData) -> tuple[Float, Array, Array] | None:
    """Places, normals and sigmas of the mesh, or of the cloud where the mesh has none."""
    mesh, cloud = data.inputs.mesh, data.inputs.cloud
    if mesh is not None and mesh.vertex_sigma is not None and mesh.vertex_normals is not None:
        found = (mesh.vertices, mesh.vertex_normals, mesh.vertex_sigma)
    elif cloud is not None and cloud.sigma is not None and cloud.normals is not None:
        found = (cloud.points, cloud.normals, cloud.sigma)
    else:
        return None
    return found if len(found[0]) else None
