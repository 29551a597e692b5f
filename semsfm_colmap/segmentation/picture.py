"""A picture of the parts in colours, seen as some of the images see them, with a legend."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from semsfm_colmap.segmentation.labels import Labelling
from semsfm_colmap.segmentation.splat import first_points
from semsfm_colmap.types import Array, Float, PointCloud

COLORS = np.array(
    [
        [150, 150, 150], [86, 180, 233], [230, 159, 0], [213, 94, 0], [0, 158, 115],
        [204, 121, 167], [240, 228, 66], [0, 114, 178],
    ]
)  # fmt: skip
"""Of the labels 0, 1, ...; the palette of Okabe and Ito, which the colour-blind can tell apart."""
PANEL_PX = (640, 480)
MARGIN = 0.06
AMBIENT = 0.35
LEGEND_PX = 34
BACKGROUND = 255


def draw_parts(
    cloud: PointCloud, labelling: Labelling, views: Sequence[Float], spacing: float
) -> Array:
    """Panels side by side, two a row, above a legend: (H, W, 3) uint8.

    Parameters
    ----------
    cloud : N points with normals
    labelling : of them
    views : cam_from_world (3, 3) of each panel
    spacing : of the points, world units

    """
    import cv2

    panels = [_panel(cloud, labelling, view, spacing) for view in views]
    if len(panels) % 2 and len(panels) > 1:
        panels.append(np.full_like(panels[0], BACKGROUND))
    rows = [np.hstack(panels[k : k + 2]) for k in range(0, len(panels), 2)]
    legend = np.full((LEGEND_PX, rows[0].shape[1], 3), BACKGROUND, dtype=np.uint8)
    x = 12
    for number in np.unique(labelling.label):
        name = labelling.names[int(number)]
        color = tuple(int(c) for c in COLORS[number % len(COLORS)])
        cv2.rectangle(legend, (x, 9), (x + 18, 25), color, -1)
        cv2.putText(
            legend, name, (x + 26, 23), cv2.FONT_HERSHEY_SIMPLEX, 0.55, (30, 30, 30), 1, cv2.LINE_AA
        )
        x += 60 + 11 * len(name)
    return np.vstack([*rows, legend])


def _panel(cloud: PointCloud, labelling: Labelling, view: Float, spacing: float) -> Array:
    seen = np.asarray(cloud.points) @ view.T
    low, high = seen[:, :2].min(axis=0), seen[:, :2].max(axis=0)
    size = np.array(PANEL_PX)
    scale = float(np.min((1.0 - 2.0 * MARGIN) * size / np.maximum(high - low, 1e-300)))
    uv = scale * (seen[:, :2] - 0.5 * (low + high)) + 0.5 * size
    cell = max(1.0, min(0.8 * spacing * scale, 4.0))
    first = first_points(uv, seen[:, 2], PANEL_PX, cell)
    light = np.ones(len(seen))
    if cloud.normals is not None:
        light = AMBIENT + (1.0 - AMBIENT) * np.abs(np.asarray(cloud.normals) @ view[2])
    color = COLORS[labelling.label % len(COLORS)] * light[:, None]
    small = np.where((first >= 0)[..., None], color[first], BACKGROUND).astype(np.uint8)
    y = np.minimum((np.arange(size[1]) / cell), small.shape[0] - 1).astype(np.int64)
    x = np.minimum((np.arange(size[0]) / cell), small.shape[1] - 1).astype(np.int64)
    return np.asarray(small[y[:, None], x])


def encode_png(pixels: Array) -> bytes:
    """Grey (H, W) or RGB (H, W, 3) pixels as the content of a PNG file."""
    import cv2

    return bytes(cv2.imencode(".png", pixels[..., ::-1] if pixels.ndim == 3 else pixels)[1])
