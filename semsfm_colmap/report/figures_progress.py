"""The structure before outliers are filtered, after, and as it is written: the paper's figure 6.

The stages leave the tracks and the final model, not the models between. With the final cameras the
points of all tracks are what the tracks would give without filtering; dropping what lies beyond the
threshold of each round, from the first to the last, and solving again gives what filtering leaves.
The third panel is the model itself: bundle adjusted, and after a guided pass where there was one.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from semsfm_colmap.geometry.rotations import rotation_from_vector
from semsfm_colmap.report.camera_frames import View, find_view
from semsfm_colmap.report.figure_style import BLUE, GREY, RED, FigureData, dress, new_figure
from semsfm_colmap.report.number_text import number, unit_text
from semsfm_colmap.report.thinning import even_subset
from semsfm_colmap.types import Bool, Float, Int, OrthographicCameras

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MAX_POINTS = 6_000
DEFAULT_THRESHOLDS_PX = (8.0, 4.0, 2.0, 1.0)
"""The paper's, where the rounds are not known."""
REACH_RADII = 1.6
"""Half the width of a panel, in radii of the model: strays farther away are counted, not drawn."""
MIN_CONDITION = 1e-6
"""Smallest over largest eigenvalue of a point's normal equations: rays 0.1 degrees apart."""
FROM_ABOVE_RAD, FROM_RIGHT_RAD = np.deg2rad(60.0), np.deg2rad(20.0)
"""Mostly from above: what is wrong with a point is its depth."""


def triangulated(
    cameras: OrthographicCameras, image_idx: Int, track_idx: Int, xy: Float, num_tracks: int
) -> Float:
    """(N, 3) the point of each track by least squares; nan where its rays do not fix one.

    Normal equations ``sum P_i^T P_i X = sum P_i^T (xy - t_i)``, one 3 x 3 system a track.
    """
    P = cameras.projection[image_idx]
    b = xy - cameras.translation_px[image_idx]
    A = np.empty((num_tracks, 3, 3))
    y = np.empty((num_tracks, 3))
    for j in range(3):
        y[:, j] = np.bincount(track_idx, np.einsum("oi,oi->o", P[:, :, j], b), num_tracks)
        for k in range(3):
            product = np.einsum("oi,oi->o", P[:, :, j], P[:, :, k])
            A[:, j, k] = np.bincount(track_idx, product, num_tracks)
    size = np.linalg.eigvalsh(A)
    known = size[:, 0] > MIN_CONDITION * np.maximum(size[:, 2], 1e-300)
    X = np.full((num_tracks, 3), np.nan)
    X[known] = np.linalg.solve(A[known], y[known][..., None])[..., 0]
    return X


def filtered(
    cameras: OrthographicCameras,
    image_idx: Int,
    track_idx: Int,
    xy: Float,
    num_tracks: int,
    thresholds_px: tuple[float, ...],
) -> tuple[Float, Bool]:
    """The points that graduated filtering with fixed cameras leaves, and which observations."""
    keep = np.ones(len(xy), dtype=bool)
    X = triangulated(cameras, image_idx, track_idx, xy, num_tracks)
    for threshold in thresholds_px:
        error = np.linalg.norm(cameras.project(X[track_idx], image_idx) - xy, axis=1)
        keep &= error < threshold
        some = np.flatnonzero(keep)
        X = triangulated(cameras, image_idx[some], track_idx[some], xy[some], num_tracks)
    return X, keep


def structure_progress(data: FigureData) -> Figure | str:
    """Figure 6: all tracks, what filtering leaves of them, and the model."""
    evidence, rec = data.inputs.evidence, data.inputs.reconstruction
    if evidence is None or evidence.tracks is None or len(evidence.tracks) == 0:
        return "the tracks are not at hand"
    model = rec.points[rec.track_length() >= 1]
    if len(model) == 0:
        return "there are no points"
    obs = evidence.tracks
    image_of = {name: i for i, name in enumerate(rec.image_names)}
    image = np.array([image_of.get(name, -1) for name in evidence.track_names])[obs.image_idx]
    rows = np.flatnonzero(image >= 0)
    image, track, xy = image[rows], obs.track_idx[rows], obs.xy[rows]
    rounds = tuple(r.threshold_px for r in data.inputs.rounds) or DEFAULT_THRESHOLDS_PX
    before = triangulated(rec.cameras, image, track, xy, obs.num_tracks)
    after, _ = filtered(rec.cameras, image, track, xy, obs.num_tracks, rounds)
    turn = rotation_from_vector(np.array([FROM_ABOVE_RAD, 0.0, 0.0])) @ rotation_from_vector(
        np.array([0.0, FROM_RIGHT_RAD, 0.0])
    )
    R = turn @ rec.cameras.cam_from_world[data.frames.image_idx[0]]
    view = find_view(model)
    figure = new_figure(9.0, 3.6)
    panels = np.ravel(figure.subplots(1, 3, sharex=True, sharey=True))
    unit = unit_text(rec.world_unit)
    for axes, points, title, color in zip(
        panels,
        (before, after, model),
        ("all tracks", f"within {rounds[-1]:.2g} px", "the model"),
        (RED, GREY, BLUE),
        strict=True,
    ):
        _panel(axes, points[np.isfinite(points).all(axis=1)], R, view, title, color)
        axes.set_xlabel(f"[{unit}]", fontsize=9, color=GREY)
    panels[0].set_ylabel(f"[{unit}]", fontsize=9, color=GREY)
    return figure


def _panel(axes: Axes, points: Float, R: Float, view: View, title: str, color: str) -> None:
    """The points seen mostly from above, and how many lie outside of the panel."""
    from matplotlib.ticker import MaxNLocator

    uv = ((points - view.center) @ R.T)[:, :2]
    half = REACH_RADII * view.radius
    inside = np.all(np.abs(uv) <= half, axis=1)
    shown = np.flatnonzero(inside)
    shown = shown[even_subset(len(shown), MAX_POINTS)]
    axes.scatter(uv[shown, 0], uv[shown, 1], s=1.0, c=color, linewidths=0, alpha=0.7)
    stray = int(np.sum(~inside))
    beside = f", {number(stray)} outside" if stray else ""
    dress(axes, title=f"{title}: {number(len(points))} points{beside}")
    axes.set_xlim(-half, half)
    axes.set_ylim(half, -half)
    axes.set_aspect("equal")
    for axis in (axes.xaxis, axes.yaxis):
        # the ends of neighbouring panels would touch
        axis.set_major_locator(MaxNLocator(nbins=5, prune="both"))
