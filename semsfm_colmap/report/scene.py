"""The interactive scene as the JSON that plotly.js reads: points, cloud, mesh, camera frames.

Data stay in the world frame of the exported model, with equal aspect; only the view is chosen: as
in the first image, x right, y down, the viewer at -z. Since plotly's scenes are right-handed, eye
``-R[2]`` and up ``-R[1]`` of the first camera put its ``R[0]`` to the right.
"""

from __future__ import annotations

import base64
import html
from dataclasses import dataclass
from typing import Any

import numpy as np

from semsfm_colmap.report.camera_frames import (
    View,
    find_view,
    frame_centers,
    frame_outlines,
    inside_view,
    labelled_frames,
)
from semsfm_colmap.report.frames import order_frames
from semsfm_colmap.report.inputs import ReportInputs
from semsfm_colmap.report.number_text import number, unit_text
from semsfm_colmap.report.options import ReportOptions
from semsfm_colmap.report.thinning import even_subset, thin_mesh
from semsfm_colmap.types import Array, Float, Int, Reconstruction, TriangleMesh

EYE_DISTANCE = 2.0
"""In plotly's units of the scene's cube; only its direction matters to a parallel projection."""
FIRST_VIEW = "as in the first image"
SURFACE_TINT = np.array([0.93, 0.97, 1.0])
RANGE_MARGIN = 1.1
"""plotly.js cuts off what lies outside the ranges: room for the labels."""
AXES_LENGTH_RADII, AXES_PLACE_RADII = 0.5, 1.2


@dataclass(frozen=True, kw_only=True)
class Switch:
    """A part of the scene that can be hidden."""

    label: str
    traces: list[int]
    """indices into `Scene.data`"""
    on: bool
    """shown at first"""


@dataclass(frozen=True, kw_only=True)
class Look:
    """One view of the scene."""

    camera: dict[str, Any]
    half_width: float
    """how far the content reaches from its middle on the screen, in world units"""
    half_height: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Scene:
    """The scene, which of its traces belong to which switch, and what was left out."""

    data: list[dict[str, Any]]
    """traces, as plotly.js reads them"""
    layout: dict[str, Any]
    """likewise"""
    switches: list[Switch]
    views: dict[str, Look]
    """of each view button"""
    remarks: list[str]


def packed(values: Array, dtype: str) -> dict[str, str]:
    """An array as plotly.js takes it: base64 of little-endian numbers."""
    raw = np.ascontiguousarray(values, dtype=f"<{dtype}").tobytes()
    return {"dtype": dtype, "bdata": base64.b64encode(raw).decode("ascii")}


def hex_colors(rgb: Array) -> list[str]:
    """(N, 3) uint8 -> ``#rrggbb``."""
    return [f"#{r:02x}{g:02x}{b:02x}" for r, g, b in rgb.tolist()]


def _xyz(points: Float) -> dict[str, Any]:
    return {letter: packed(points[:, k], "f4") for k, letter in enumerate("xyz")}


def _point_trace(points: Float, color: Any, *, size: float, shown: bool) -> dict[str, Any]:
    marker: dict[str, Any] = {"size": size, "color": color, "line": {"width": 0}}
    if isinstance(color, dict):
        marker["colorscale"] = "Viridis"
    return {
        "type": "scatter3d", "mode": "markers", **_xyz(points), "marker": marker,
        "hoverinfo": "skip", "visible": shown,
    }  # fmt: skip


def _point_traces(
    points: Float, colors: Array | None, view: View, towards: Float, shown: bool, max_points: int
) -> tuple[dict[str, Any], str]:
    """Thin the points in view; without colours, colour them by depth in the first image."""
    seen = np.flatnonzero(inside_view(points, view))
    idx = seen[even_subset(len(seen), max_points)]
    color = packed(points[idx] @ towards, "f4") if colors is None else hex_colors(colors[idx])
    size = 1.6 if len(idx) > 8000 else 2.4
    stray = len(points) - len(seen)
    remark = f"{number(len(idx))} of {number(len(points))}"
    remark += f" ({number(stray)} far from the object left out)" if stray else ""
    return _point_trace(points[idx], color, size=size, shown=shown), remark


def shaded_grey(mesh: TriangleMesh, R: Float) -> Array:
    """(V, 3) uint8: grey by vertex normal, bright above, on the left and toward front and back.

    Painted once in the frame `R` of the first camera: plotly.js places its own light in clip
    coordinates, where the direction depends on the depth range of the scene.
    """
    corner = mesh.vertices[mesh.faces]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    total = np.zeros((len(mesh.vertices), 3))
    for k in range(3):
        for axis in range(3):
            total[:, axis] += np.bincount(
                mesh.faces[:, k], weights=normal[:, axis], minlength=len(total)
            )
    length = np.linalg.norm(total, axis=1, keepdims=True)
    right, down, away = R @ (total / np.where(length > 0.0, length, 1.0)).T
    light = 0.52 - 0.20 * down - 0.16 * right + 0.22 * np.abs(away)
    return np.clip(255.0 * light[:, None] * SURFACE_TINT, 0.0, 255.0).astype(np.uint8)


def _mesh_trace(mesh: TriangleMesh, R: Float, *, shown: bool) -> dict[str, Any]:
    colors = shaded_grey(mesh, R) if mesh.vertex_colors is None else mesh.vertex_colors
    corners = {letter: packed(mesh.faces[:, k], "i4") for k, letter in enumerate("ijk")}
    return {
        "type": "mesh3d", **_xyz(mesh.vertices), **corners, "vertexcolor": hex_colors(colors),
        "lighting": {"ambient": 1.0, "diffuse": 0.0, "specular": 0.0, "fresnel": 0.0},
        "hoverinfo": "skip", "visible": shown,
    }  # fmt: skip


def _camera_traces(
    rec: Reconstruction, order: Int, numbers: Int, names: list[str], view: View
) -> list[dict[str, Any]]:
    """The frames in one line with gaps, their centres to hover over, and some numbers."""
    outlines = frame_outlines(rec, view)[order]
    gap = np.full((len(order), 1, 3), np.nan)
    lines = np.concatenate([outlines, gap], axis=1)
    color = np.repeat(numbers.astype(float), lines.shape[1])
    centers = frame_centers(rec, view)[order]
    labelled = labelled_frames(numbers)
    return [
        {
            "type": "scatter3d", "mode": "lines", **_xyz(lines.reshape(-1, 3)),
            "line": {"width": 3, "color": packed(color, "f4"), "colorscale": "Portland"},
            "connectgaps": False, "hoverinfo": "skip",
        },
        {
            "type": "scatter3d", "mode": "markers", **_xyz(centers),
            "marker": {"size": 5, "color": "#4a5568", "opacity": 0.6},
            "text": [f"{n}: {html.escape(name)}" for n, name in zip(numbers, names, strict=True)],
            "hovertemplate": "%{text}<extra></extra>",
        },
        {
            "type": "scatter3d", "mode": "text", **_xyz(outlines[labelled, 2]),
            "text": [str(n) for n in numbers[labelled]], "hoverinfo": "skip",
            "textfont": {"size": 13, "color": "#1a202c"},
        },
    ]  # fmt: skip


def _xyz_of(v: Float) -> dict[str, float]:
    return {letter: float(c) for letter, c in zip("xyz", v, strict=True)}


def _look(eye: Float, up: Float, extent: Float) -> Look:
    """A view along ``-eye`` and how far the content reaches from its middle on the screen.

    `extent` (P, 3) are the points that should be in the picture, relative to its centre.
    """
    eye = eye / np.linalg.norm(eye)
    right = np.cross(up, eye) / np.linalg.norm(np.cross(up, eye))
    camera = {
        "eye": _xyz_of(EYE_DISTANCE * eye), "up": _xyz_of(up), "center": _xyz_of(np.zeros(3)),
        "projection": {"type": "orthographic"},
    }  # fmt: skip
    return Look(
        camera=camera,
        half_width=float(np.max(np.abs(extent @ right))),
        half_height=float(np.max(np.abs(extent @ np.cross(eye, right)))),
    )


def _layout(unit: str, view: View, extent: Float, camera: dict[str, Any]) -> dict[str, Any]:
    """Ranges around the centre of the object, so that it turns in place.

    The script sets the aspect ratio from them, equal for all axes, when it knows the page's size.
    """
    reach = RANGE_MARGIN * np.max(np.abs(extent), axis=0)
    axis = {"showbackground": False, "gridcolor": "#dde3ea", "visible": False}
    scene: dict[str, Any] = {
        f"{letter}axis": {
            **axis,
            "title": {"text": f"{letter} [{unit}]"},
            "range": [float(view.center[k] - reach[k]), float(view.center[k] + reach[k])],
        }
        for k, letter in enumerate("xyz")
    }
    scene |= {"aspectmode": "manual", "camera": camera, "dragmode": "orbit"}
    return {
        "scene": scene, "showlegend": False, "paper_bgcolor": "#ffffff", "autosize": True,
        "margin": {"l": 0, "r": 0, "t": 0, "b": 0},
        "font": {"family": "system-ui, sans-serif", "size": 12},
    }  # fmt: skip


def round_length(length: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that does not exceed a length."""
    power = 10.0 ** np.floor(np.log10(length))
    return float(max(m for m in (1.0, 2.0, 5.0) if m * power <= length * (1.0 + 1e-9)) * power)


def _axes_tips(view: View, R: Float) -> Float:
    """(4, 3) origin and tips of the drawn axes, at the upper left of the first image."""
    origin = view.center - AXES_PLACE_RADII * view.radius * (R[0] + R[1])
    length = round_length(AXES_LENGTH_RADII * view.radius)
    return origin + length * np.concatenate([np.zeros((1, 3)), np.eye(3)])


def _axes_traces(view: View, R: Float, unit: str) -> list[dict[str, Any]]:
    """The world's axes, of a round length."""
    origin, *tips = _axes_tips(view, R)
    length = round_length(AXES_LENGTH_RADII * view.radius)
    color = ("#c53030", "#2f855a", "#2b6cb0")
    lines = [
        {
            "type": "scatter3d", "mode": "lines", **_xyz(np.stack([origin, tip])),
            "line": {"width": 5, "color": shade}, "hoverinfo": "skip",
        }
        for tip, shade in zip(tips, color, strict=True)
    ]  # fmt: skip
    names = {
        "type": "scatter3d", "mode": "text", **_xyz(origin + 1.25 * length * np.eye(3)),
        "text": [f"x {number(length, 1)} {unit}", "y", "z"], "hoverinfo": "skip",
        "textposition": ["top center", "bottom center", "top center"],
        "textfont": {"size": 13, "color": list(color)},
    }  # fmt: skip
    return [*lines, names]


def build_scene(inputs: ReportInputs, options: ReportOptions | None = None) -> Scene | None:
    """All traces of the scene; None when there is nothing to show."""
    options = options or ReportOptions()
    rec, mesh, cloud = inputs.reconstruction, inputs.mesh, inputs.cloud
    seen = rec.track_length() >= 1
    points = rec.points[seen]
    shape = [points, *([] if cloud is None else [cloud.points])]
    shape += [] if mesh is None else [mesh.vertices]
    solid = next((p for p in shape if len(p)), None)
    if solid is None:
        return None
    view = find_view(solid)
    frames = order_frames(inputs)
    R = rec.cameras.cam_from_world[frames.image_idx[0]] if rec.num_images else np.eye(3)
    limit = options.max_scene_points
    data: list[dict[str, Any]] = []
    switches: list[Switch] = []
    remarks: list[str] = []

    def add(label: str, traces: list[dict[str, Any]], shown: bool) -> None:
        at = list(range(len(data), len(data) + len(traces)))
        switches.append(Switch(label=label, traces=at, on=shown))
        data.extend(traces)

    if len(points):
        colors = None if rec.point_color is None else rec.point_color[seen]
        trace, remark = _point_traces(points, colors, view, R[2], True, limit)
        add("points", [trace], True)
        remarks.append(f"Points: {remark}.")
    if cloud is not None and len(cloud.points):
        shown = not len(points)
        trace, remark = _point_traces(cloud.points, cloud.colors, view, R[2], shown, limit)
        add("dense cloud", [trace], shown)
        remarks.append(f"Dense cloud: {remark}.")
    if mesh is not None and len(mesh.faces):
        thin = thin_mesh(mesh, options.max_scene_faces)
        shown = not switches
        add("mesh", [_mesh_trace(thin, R, shown=shown)], shown)
        remarks.append(f"Mesh: {number(len(thin.faces))} of {number(len(mesh.faces))} faces.")
    if rec.num_images:
        names = [frames.names[k] for k in frames.registered]
        add("cameras", _camera_traces(rec, frames.image_idx, frames.numbers, names, view), True)
    unit = unit_text(rec.world_unit)
    add("axes", _axes_traces(view, R, unit), True)

    extent = np.concatenate(
        [
            _axes_tips(view, R) - view.center,
            frame_outlines(rec, view).reshape(-1, 3) - view.center,
            solid[inside_view(solid, view)] - view.center,
        ]
    )
    views = {
        FIRST_VIEW: _look(-R[2], -R[1], extent),
        "from the right": _look(R[0], -R[1], extent),
        "from above": _look(-R[1], R[2], extent),
        "oblique": _look(-R[2] - 0.7 * R[1] + 0.6 * R[0], -R[1], extent),
    }
    layout = _layout(unit, view, extent, views[FIRST_VIEW].camera)
    return Scene(data=data, layout=layout, switches=switches, views=views, remarks=remarks)
