"""What the viewer shows: layers, camera frames, axis, images, and places that can be measured.

Data stay in the world frame of the exported model; only the view is chosen: as in the first image,
x right, y down, the viewer at -z. A place that is picked snaps to a vertex of mesh.ply, which
`semsfm measure` knows as ``vertex:NUMBER``: a page holds those nearest to the vertices of what it
draws, a viewer beside its server all.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from semsfm_colmap.geometry.mesh_normals import vertex_normals
from semsfm_colmap.io.ply import position_type
from semsfm_colmap.io.terminal import printable_line
from semsfm_colmap.motion.axis import fit_axis
from semsfm_colmap.report.camera_frames import (
    View,
    find_view,
    frame_outlines,
    inside_view,
    labelled_frames,
)
from semsfm_colmap.report.frames import order_frames
from semsfm_colmap.report.inputs import ReportInputs
from semsfm_colmap.report.number_text import number, unit_text
from semsfm_colmap.report.options import ReportOptions
from semsfm_colmap.report.thinning import even_subset, thin_mesh
from semsfm_colmap.report.viewer.layers import (
    Layer,
    cloud_layer,
    mesh_layer,
    points_layer,
    signed,
)
from semsfm_colmap.report.viewer.packing import pack
from semsfm_colmap.report.viewer.pictures import encoded, series_pictures
from semsfm_colmap.types import Array, Float, Int, TriangleMesh

FIRST_VIEW = "as in the first image"
AXIS_RADII = 1.35
"""Half the length of the drawn rotation axis."""
COLORMAP = "viridis"
UNLIMITED = 10**12
SAME_SURFACE = 0.02
"""A textured mesh that lies farther off the mesh than this share of its extent is another's."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ViewerScene:
    """What the script reads, and what was left out."""

    header: dict[str, Any]
    arrays: dict[str, Array]
    remarks: list[str]

    @cached_property
    def packed(self) -> bytes:
        """Header and arrays in one run of bytes."""
        return pack(self.header, self.arrays)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Measured:
    """The mesh that places snap to."""

    mesh: TriangleMesh

    @cached_property
    def _tree(self) -> Any:
        from scipy.spatial import cKDTree

        return cKDTree(self.mesh.vertices)

    def nearest(self, points: Float) -> Int:
        """(K,) numbers of the vertices nearest to places (K, 3)."""
        return np.asarray(self._tree.query(points)[1], dtype=np.int64)

    def holds(self, textured: TriangleMesh) -> bool:
        """Whether a textured mesh was made from this one: it lies on it."""
        away = self._tree.query(textured.vertices)[0]
        extent = float(np.ptp(self.mesh.vertices, axis=0).max())
        return bool(np.median(away) <= SAME_SURFACE * extent)


def build_scene(
    inputs: ReportInputs,
    options: ReportOptions | None = None,
    *,
    live: bool = False,
    max_picture_bytes: int = 0,
) -> ViewerScene | None:
    """Gather all that is there; None when there is nothing to show.

    Parameters
    ----------
    live : for a page beside its server: nothing is left out of the mesh, and images and budgets
        are asked for when they are wanted
    max_picture_bytes : of the images of the series within the scene

    """
    options = options or ReportOptions()
    rec, mesh, cloud = inputs.reconstruction, inputs.mesh, inputs.cloud
    seen = np.flatnonzero(rec.track_length() >= 1)
    solid = [rec.points[seen], *([] if cloud is None else [cloud.points])]
    solid += [] if mesh is None or len(mesh.faces) == 0 else [mesh.vertices]
    if not any(len(p) for p in solid):
        return None
    body = solid[-1] if len(solid[-1]) else next(p for p in solid if len(p))
    view = find_view(body)
    near = position_type(body) == np.dtype("<f4")
    origin = np.zeros(3) if near else np.round(view.center)
    frames = order_frames(inputs)
    R = rec.cameras.cam_from_world[frames.image_idx[0]] if rec.num_images else np.eye(3)
    layers: list[Layer] = []
    header: dict[str, Any] = {}
    arrays: dict[str, Array] = {}
    remarks: list[str] = []

    if mesh is not None and len(mesh.faces):
        found, more, remark = _surface(inputs, mesh, origin, options, live=live)
        layers += found
        remarks.append(remark)
        header |= more[0]
        arrays |= more[1]
    limit = UNLIMITED if live else options.max_scene_points
    if cloud is not None and len(cloud.points):
        some, remark = _some(cloud.points, view, limit)
        layers.append(cloud_layer(cloud, some, origin, shown=not layers))
        remarks.append(f"Dense cloud: {remark}.")
    if len(seen):
        some, remark = _some(rec.points[seen], view, limit)
        layers.append(points_layer(rec, seen[some], origin, shown=not layers))
        remarks.append(f"Points: {remark}.")
    for layer in layers:
        arrays |= layer.named()
    if rec.num_images:
        found_frames, of_frames = _frames(inputs, view, origin)
        header["frames"] = found_frames
        arrays |= of_frames
        if max_picture_bytes > 0:
            names = [rec.image_names[frame["image"]] for frame in found_frames]
            pictures = series_pictures(names, inputs.viewer.picture, max_picture_bytes)
            for k, picture in enumerate(pictures):
                if picture is not None:
                    arrays[f"picture.{k}"] = np.frombuffer(picture, dtype=np.uint8)
    axis = fit_axis(rec.cameras.cam_from_world[frames.image_idx]) if rec.num_images > 1 else None
    if axis is not None and len(inputs.series.series_names) == 1:
        header["axis"] = axis.axis_world.tolist()
    header |= {
        "title": printable_line(inputs.title),
        "unit": unit_text(rec.world_unit),
        "center": (view.center - origin).tolist(),
        "radius": view.radius,
        "axis_radii": AXIS_RADII,
        "origin": origin.tolist(),
        "toward_viewer": (-R[2]).tolist(),
        "views": _views(R),
        "layers": [layer.header() for layer in layers],
        "labels": {str(k): printable_line(name) for name, k in inputs.viewer.label_names.items()},
    }
    arrays["colormap"] = _colormap()
    return ViewerScene(header=header, arrays=arrays, remarks=remarks)


def _surface(
    inputs: ReportInputs, mesh: TriangleMesh, origin: Float, options: ReportOptions, *, live: bool
) -> tuple[list[Layer], tuple[dict[str, Any], dict[str, Array]], str]:
    """The mesh as it is drawn, its texture, the places that can be measured, and a remark."""
    viewer = inputs.viewer
    header: dict[str, Any] = {}
    arrays: dict[str, Array] = {}
    measured = _Measured(mesh=mesh)
    drawn = mesh
    if viewer.textured is not None and measured.holds(viewer.textured):
        drawn = viewer.textured
    limit = UNLIMITED if live else options.max_scene_faces
    remark = f"{number(len(drawn.faces))} of {number(len(mesh.faces))} faces"
    if len(drawn.faces) > limit:
        drawn = thin_mesh(drawn, limit)
        remark = f"{number(len(drawn.faces))} of {number(len(mesh.faces))} faces, without texture"
    if drawn.texture is not None and drawn.uv is not None:
        data, kind = encoded(drawn.texture, lossless=live)
        arrays["texture"] = np.frombuffer(data, dtype=np.uint8)
        header["texture"] = kind
    values = _values(mesh, inputs)
    number_of = measured.nearest(drawn.vertices)
    places = np.arange(len(mesh.vertices)) if live else np.unique(number_of)
    normals = mesh.vertex_normals
    normals = vertex_normals(mesh.vertices, mesh.faces) if normals is None else normals
    arrays["place.id"] = places.astype(np.uint32)
    arrays["place.position"] = (mesh.vertices[places] - origin).astype(np.float32)
    arrays["place.normal"] = signed(np.asarray(normals)[places], np.int16)
    if mesh.vertex_sigma is not None:
        arrays["place.sigma"] = np.asarray(mesh.vertex_sigma)[places].astype(np.float32)
    if viewer.seen is not None:
        some = np.unique(number_of)
        sees, weights = viewer.seen(some)
        views = np.zeros(len(mesh.vertices), dtype=np.uint16)
        views[some] = (sees > 0).sum(axis=1)
        values["views"] = views
        if not live and viewer.errors is not None:
            arrays["place.seen"] = np.packbits(weights > 0, axis=1, bitorder="little")
    if not live and viewer.errors is not None:
        header["errors"] = dict(viewer.errors)
        arrays |= {f"errors.{key}": value for key, value in viewer.error_arrays.items()}
    layers = [
        mesh_layer(
            drawn, origin, name="mesh", label="mesh", shown=True, values=values,
            nearest=measured.nearest,
        )
    ]  # fmt: skip
    if live and drawn is not mesh and len(drawn.faces) < len(mesh.faces):
        values.pop("views", None)
        layers.append(
            mesh_layer(
                mesh, origin, name="full", label="mesh, all faces", shown=False, values=values,
                nearest=lambda points: np.arange(len(points)),
            )
        )  # fmt: skip
    return layers, (header, arrays), f"Mesh: {remark}."


def _values(mesh: TriangleMesh, inputs: ReportInputs) -> dict[str, Array]:
    """What is known of each vertex of the mesh."""
    values: dict[str, Array] = {}
    if mesh.vertex_sigma is not None:
        values["sigma"] = np.asarray(mesh.vertex_sigma).astype(np.float32)
    if inputs.viewer.labels is not None:
        values["label"] = np.asarray(inputs.viewer.labels).astype(np.uint16)
    return values


def _some(points: Float, view: View, max_points: int) -> tuple[Int, str]:
    """The points worth showing, and how many they are in words."""
    inside = np.flatnonzero(inside_view(points, view))
    some = inside[even_subset(len(inside), max_points)]
    stray = len(points) - len(inside)
    remark = f"{number(len(some))} of {number(len(points))}"
    return some, remark + (f" ({number(stray)} far from the object left out)" if stray else "")


def _frames(
    inputs: ReportInputs, view: View, origin: Float
) -> tuple[list[dict[str, Any]], dict[str, Array]]:
    """The images in their order: names and rotations; outlines, and corners through the middle."""
    rec, frames = inputs.reconstruction, order_frames(inputs)
    order = frames.image_idx
    labelled = set(labelled_frames(frames.numbers).tolist())
    found = [
        {
            "number": int(frames.numbers[k]),
            "name": printable_line(frames.names[frames.registered[k]]),
            "image": int(i),
            "labelled": k in labelled,
            "rotation": rec.cameras.cam_from_world[i].ravel().tolist(),
        }
        for k, i in enumerate(order)
    ]
    size = rec.image_size_px[order].astype(np.float64)
    q = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])[None] * size[:, None]
    A = rec.cameras.projection[order]
    back = np.linalg.solve(A @ A.transpose(0, 2, 1), A)  # (M, 2, 3)
    across = np.einsum("mcx,mxi->mci", q - rec.cameras.translation_px[order][:, None], back)
    v = np.asarray(rec.cameras.viewing_direction)[order]
    corners = across + (v @ view.center)[:, None, None] * v[:, None]
    outlines = frame_outlines(rec, view)[order]
    return found, {
        "frame.outline": (outlines - origin).astype(np.float32),
        "frame.corner": (corners - origin).astype(np.float32),
    }


def _views(R: Float) -> list[dict[str, Any]]:
    """Views by where the viewer stands and what is up, relative to the first image."""
    right, down, away = R
    stands = {
        FIRST_VIEW: (-away, -down),
        "from behind": (away, -down),
        "from the left": (-right, -down),
        "from the right": (right, -down),
        "from above": (-down, away),
        "from below": (down, -away),
        "oblique": (-away - 0.7 * down + 0.6 * right, -down),
    }
    out = []
    for name, (eye, up) in stands.items():
        eye = eye / np.linalg.norm(eye)
        x = np.cross(up, eye)
        x /= np.linalg.norm(x)
        rows = np.concatenate([x, np.cross(eye, x), eye])
        out.append({"name": name, "right_up_back": rows.tolist()})
    return out


def _colormap() -> Array:
    from matplotlib import colormaps

    return np.rint(255.0 * colormaps[COLORMAP](np.arange(256))[:, :3]).astype(np.uint8)


def fewer(options: ReportOptions, share: float) -> ReportOptions:
    """Options for a share of the points and faces."""
    return replace(
        options,
        max_scene_points=max(1000, int(options.max_scene_points * share)),
        max_scene_faces=max(1000, int(options.max_scene_faces * share)),
    )
