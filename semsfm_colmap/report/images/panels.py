"""Everything that the page's script needs to show the images, packed.

The panel of an image has the image itself, the mesh as its camera sees it, its depth map and sigma
map as pictures, and as numbers its keypoints, residuals and matches. Pictures of all frames have
one width, which their budget sets.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from semsfm_colmap.errors import InputError, MissingDependencyError
from semsfm_colmap.records import MATCH_STEPS
from semsfm_colmap.report.frames import Frames, order_frames
from semsfm_colmap.report.images.budgets import Budgets
from semsfm_colmap.report.images.colormaps import (
    ColorRange,
    color_range,
    color_table,
    colored,
    css_stops,
    shrunk_map,
)
from semsfm_colmap.report.images.epipolar_lines import packed_cameras, packed_pair
from semsfm_colmap.report.images.evidence import SeriesEvidence
from semsfm_colmap.report.images.fates import FATE_LABELS, Fate, keypoint_fates
from semsfm_colmap.report.images.marks import (
    SizePx,
    packed_keypoints,
    packed_residual_vectors,
    packed_trajectories,
    residual_vectors,
)
from semsfm_colmap.report.images.mesh_view import MeshView
from semsfm_colmap.report.images.packed import RESIDUAL_STEP_PX, SCALE_STEP, SMALLEST_PX
from semsfm_colmap.report.images.pictures import (
    WIDTHS_PX,
    data_uri,
    shrunk,
    spread,
    webp,
    width_within,
)
from semsfm_colmap.report.inputs import ReportInputs
from semsfm_colmap.report.number_text import unit_text
from semsfm_colmap.types import Array, DepthMap, Float, ParallelMap

THUMBNAIL_WIDTHS_PX = (144, 112, 96, 80, 64, 48)
THUMBNAIL_QUALITY = 45
MAP_TABLES = {"depth": "viridis", "sigma": "magma"}


@dataclass(frozen=True, kw_only=True, eq=False)
class Panels:
    """The images of the report."""

    thumbnails: tuple[str | None, ...]
    """of all frames, as addresses; None where the image could not be read"""
    data: dict[str, Any]
    """for the script"""
    remarks: tuple[str, ...]
    """what was made smaller or thinned out, in sentences"""


def build_panels(
    inputs: ReportInputs,
    residual: Float,
    budgets: Budgets | None = None,
    parallel_map: ParallelMap = map,
) -> Panels | None:
    """Pack the images of a series; None where none are at hand.

    Parameters
    ----------
    residual : (O, 2) px, of all observations

    """
    evidence, limits = inputs.evidence, budgets or Budgets()
    if evidence is None:
        return None
    frames = order_frames(inputs)
    sizes = _sizes(inputs, frames)
    pictures, width = _pictures(evidence, frames, limits, parallel_map)
    if not pictures:
        return None
    meshes = _mesh_pictures(inputs, frames, sizes, limits)
    maps = _map_pictures(evidence, frames, limits, parallel_map)
    numbers = _numbers(inputs, evidence, frames, sizes, residual, limits)
    entries = [
        {
            "number": k + 1,
            "name": name,
            "size": list(sizes[k]),
            "picture": pictures[k][0] if k in pictures else None,
            "mesh": meshes.get(k),
            **maps.get(k, {}),
            **numbers[k],
        }
        for k, name in enumerate(frames.names)
    ]
    pairs = _pairs(evidence, frames, sizes, limits)
    tracks = packed_trajectories(inputs.reconstruction, frames, sizes, limits.num_trajectory_places)
    data = {
        "frames": entries,
        "pairs": pairs,
        "tracks": tracks,
        "steps": list(MATCH_STEPS),
        "fates": [FATE_LABELS[fate] for fate in Fate],
        "unit": unit_text(inputs.reconstruction.world_unit),
        "colors": {kind: css_stops(color_table(table)) for kind, table in MAP_TABLES.items()},
        "code": {"scale": SCALE_STEP, "smallest": SMALLEST_PX, "residual": RESIDUAL_STEP_PX},
    }
    return Panels(
        thumbnails=tuple(
            pictures[k][1] if k in pictures else None for k in range(len(frames.names))
        ),
        data=data,
        remarks=tuple(_remarks(entries, pairs, tracks, sizes, width)),
    )


def _sizes(inputs: ReportInputs, frames: Frames) -> list[SizePx]:
    """Width and height of each frame."""
    known = {f.name: (f.width_px, f.height_px) for f in inputs.series.frames}
    for name, size in zip(
        inputs.reconstruction.image_names, inputs.reconstruction.image_size_px, strict=True
    ):
        known.setdefault(name, (int(size[0]), int(size[1])))
    return [known[name] for name in frames.names]


def pixels_of(evidence: SeriesEvidence, name: str) -> Array | None:
    """The pixels of an image; None where the file is gone, which is no reason for no report."""
    try:
        return evidence.read_pixels(name)
    except InputError:
        return None


def _pictures(
    evidence: SeriesEvidence, frames: Frames, limits: Budgets, parallel_map: ParallelMap
) -> tuple[dict[int, tuple[str, str]], int]:
    """Each image and its thumbnail at the largest widths that the budgets allow; the first width.

    Images whose files are gone are left out.
    """
    num = len(frames.names)
    some = [pixels_of(evidence, frames.names[k]) for k in spread(num)]
    tried = [pixels for pixels in some if pixels is not None]
    if not tried:
        return {}, 0

    def large(pixels: Array, width: int) -> bytes:
        return webp(shrunk(pixels, width))

    def small(pixels: Array, width: int) -> bytes:
        return webp(shrunk(pixels, width), THUMBNAIL_QUALITY)

    width = width_within(limits.picture_bytes, num, [partial(large, p) for p in tried], WIDTHS_PX)
    thumbnail = width_within(
        limits.thumbnail_bytes, num, [partial(small, p) for p in tried], THUMBNAIL_WIDTHS_PX
    )

    def both(k: int) -> tuple[str, str] | None:
        pixels = pixels_of(evidence, frames.names[k])
        if pixels is None:
            return None
        return data_uri(large(pixels, width)), data_uri(small(pixels, thumbnail))

    encoded = enumerate(parallel_map(both, range(num)))
    return {k: pictures for k, pictures in encoded if pictures is not None}, width


def _mesh_pictures(
    inputs: ReportInputs, frames: Frames, sizes: Sequence[SizePx], limits: Budgets
) -> dict[int, str]:
    """The mesh as each registered camera sees it."""
    mesh, rec = inputs.mesh, inputs.reconstruction
    if mesh is None or len(mesh.faces) == 0 or rec.num_images == 0:
        return {}
    try:
        view = MeshView(mesh)
    except MissingDependencyError:
        return {}  # the core alone: what the images show is left
    image_of = dict(zip(frames.registered.tolist(), frames.image_idx.tolist(), strict=True))
    registered = list(image_of)

    def encoder(k: int) -> Callable[[int], bytes]:
        return lambda width: webp(view.shaded(view.hits(rec.cameras, image_of[k], sizes[k], width)))

    tried = [encoder(registered[k]) for k in spread(len(registered), 2)]
    height = max(h / w for w, h in sizes)
    most = np.sqrt(limits.mesh_pixels / (len(registered) * height))
    widths = [w for w in WIDTHS_PX if w <= max(most, WIDTHS_PX[-1])]
    width = width_within(limits.mesh_bytes, len(registered), tried, widths)
    return {k: data_uri(encoder(k)(width)) for k in registered}


def _map_pictures(
    evidence: SeriesEvidence, frames: Frames, limits: Budgets, parallel_map: ParallelMap
) -> dict[int, dict[str, Any]]:
    """Depth map and sigma map of each frame that has them, coloured, with their ranges."""
    tables = {kind: color_table(name) for kind, name in MAP_TABLES.items()}
    widths = [w for w in WIDTHS_PX if w <= limits.max_map_width_px]

    def read(k: int) -> dict[str, tuple[Array, ColorRange]]:
        depth_map = evidence.read_depth_map(frames.names[k])
        found = {}
        for kind, values in _maps_of(depth_map).items():
            small = shrunk_map(values, widths[0])
            span = color_range(small)
            if span is not None:
                found[kind] = small, span
        return found

    maps = {k: m for k, m in enumerate(parallel_map(read, range(len(frames.names)))) if m}
    both = [(k, kind) for k, kinds in maps.items() for kind in kinds]
    if not both:
        return {}

    def encoder(k: int, kind: str) -> Callable[[int], bytes]:
        values, span = maps[k][kind]
        return lambda width: webp(colored(shrunk_map(values, width), span, tables[kind]))

    tried = [encoder(*both[k]) for k in spread(len(both), 6)]
    width = width_within(limits.map_bytes, len(both), tried, widths)

    def picture(one: tuple[int, str]) -> dict[str, Any]:
        span = maps[one[0]][one[1]][1]
        return {"picture": data_uri(encoder(*one)(width)), "low": span.low, "high": span.high}

    pictures: dict[int, dict[str, Any]] = {}
    for (k, kind), entry in zip(both, parallel_map(picture, both), strict=True):
        pictures.setdefault(k, {})[kind] = entry
    return pictures


def _maps_of(depth_map: DepthMap | None) -> dict[str, Array]:
    if depth_map is None:
        return {}
    maps = {"depth": depth_map.depth}
    if depth_map.sigma is not None:
        # half-precision numbers end at 65504: what is beyond them is not known
        maps["sigma"] = np.where(np.isfinite(depth_map.depth), depth_map.sigma, np.nan)
    return maps


def _numbers(
    inputs: ReportInputs,
    evidence: SeriesEvidence,
    frames: Frames,
    sizes: Sequence[SizePx],
    residual: Float,
    limits: Budgets,
) -> list[dict[str, Any]]:
    """Keypoints, residuals and camera of each frame."""
    rec = inputs.reconstruction
    obs = rec.observations
    num = max(len(frames.names), 1)
    image_of = dict(zip(frames.registered.tolist(), frames.image_idx.tolist(), strict=True))
    pairs_of: dict[str, list[Any]] = {name: [] for name in frames.names}
    for pair in evidence.pairs:
        for name in pair.names:
            if name in pairs_of:
                pairs_of[name].append(pair)
    found: list[dict[str, Any]] = []
    for k, name in enumerate(frames.names):
        entry: dict[str, Any] = {}
        i = image_of.get(k)
        mine = np.zeros(len(obs), dtype=bool) if i is None else (obs.image_idx == i) & rec.inlier
        if name in evidence.images:
            keypoints = keypoint_fates(
                name,
                evidence.images[name],
                pairs_of[name],
                obs.keypoint_idx[mine],
                obs.xy[mine],
            )
            most = min(limits.max_keypoints, limits.num_keypoints // num)
            entry["keypoints"] = packed_keypoints(keypoints, sizes[k], most)
        if i is not None:
            most = min(limits.max_residuals, limits.num_residuals // num)
            vectors = residual_vectors(rec, residual, i, most)
            entry["residuals"] = packed_residual_vectors(vectors, sizes[k])
            entry["camera"] = packed_cameras(rec.cameras, i)
        found.append(entry)
    return found


def _pairs(
    evidence: SeriesEvidence, frames: Frames, sizes: Sequence[SizePx], limits: Budgets
) -> list[dict[str, Any]]:
    """The matched pairs, in the order of their frames."""
    frame_of = {name: k for k, name in enumerate(frames.names)}
    known = [
        pair
        for pair in evidence.pairs
        if all(name in frame_of and name in evidence.images for name in pair.names)
    ]
    most = min(limits.max_matches, limits.num_matches // max(len(known), 1))
    packed = [packed_pair(p, evidence.images, frame_of, sizes, most) for p in known]
    return sorted(packed, key=lambda pair: pair["frames"])


def _remarks(
    entries: Sequence[dict[str, Any]],
    pairs: Sequence[dict[str, Any]],
    tracks: dict[str, Any],
    sizes: Sequence[SizePx],
    width_px: int,
) -> list[str]:
    """What the page does not show in full."""
    remarks = []
    if width_px < max(width for width, _ in sizes):
        remarks.append(f"Images are shown {width_px} px wide.")
    for label, things in (
        ("keypoints", [e["keypoints"] for e in entries if "keypoints" in e]),
        ("residual vectors", [e["residuals"] for e in entries if "residuals" in e]),
        ("matches", [{"num": p["num"], "total": sum(p["counts"])} for p in pairs]),
        ("tracks", [tracks]),
    ):
        shown, total = (sum(t[key] for t in things) for key in ("num", "total"))
        if shown < total:
            how = "the longest" if label == "tracks" else "evenly chosen"
            remarks.append(f"{shown} of {total} {label} are drawn, {how}.")
    return remarks
