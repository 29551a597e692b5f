"""Images of the series with what was found in them: the paper's figures 3, 4 and 5."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from semsfm_colmap.records import MATCH_STEPS
from semsfm_colmap.report.figure_style import BLUE, GREY, RED, FigureData, new_figure
from semsfm_colmap.report.images.evidence import PairEvidence, SeriesEvidence
from semsfm_colmap.report.images.fates import region_shapes
from semsfm_colmap.report.images.panels import pixels_of
from semsfm_colmap.report.images.pictures import shrunk
from semsfm_colmap.report.number_text import number
from semsfm_colmap.report.thinning import even_subset
from semsfm_colmap.types import Array, Float

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PIXELS_WIDE = 900
"""More than a figure shows at its size."""
MAX_REGIONS, MAX_LINES, MAX_TRACKS = 400, 120, 250
"""More would hide the image and one another."""
REACH = 4
"""Frames before and after that a trajectory goes through."""
REGION_COLOR, KEPT, DROPPED = "#ffd166", "#3ddc84", "#f0524f"
OUTLINE_SCALES = 2.0
"""Twice the scale outlines a blob."""
NO_IMAGES = "the images are not at hand"


def _middle_image(data: FigureData) -> tuple[SeriesEvidence, str, Array] | None:
    """The registered image in the middle of the series whose pixels can be read."""
    evidence, names = data.inputs.evidence, data.frames.names
    if evidence is None or len(names) == 0:
        return None
    registered = data.frames.registered.tolist() or list(range(len(names)))
    for k in sorted(registered, key=lambda k: abs(k - registered[len(registered) // 2])):
        pixels = pixels_of(evidence, names[k])
        if pixels is not None:
            return evidence, names[k], pixels
    return None


def _show(axes: Axes, pixels: Array, title: str) -> None:
    """An image in its own pixel coordinates, without a frame."""
    height, width = pixels.shape
    axes.imshow(shrunk(pixels, PIXELS_WIDE), cmap="gray", extent=(0, width, height, 0))
    axes.set_xlim(0, width)
    axes.set_ylim(height, 0)
    axes.set_axis_off()
    axes.set_title(title, fontsize=9, loc="left", color=GREY)


def _figure_of(pixels: Array, columns: int = 1, rows: int = 1, width_in: float = 8.0) -> Figure:
    height, width = pixels.shape
    return new_figure(width_in, rows * (width_in / columns * height / width + 0.3))


def detected_regions(data: FigureData) -> Figure | str:
    """Figure 3: keypoints of the middle image as ellipses of their scale, with orientation."""
    from matplotlib.collections import LineCollection, PolyCollection

    found = _middle_image(data)
    if found is None:
        return NO_IMAGES
    evidence, name, pixels = found
    if name not in evidence.images or len(evidence.images[name].keypoints) == 0:
        return "no keypoints are known"
    keypoints = evidence.images[name].keypoints
    rows = even_subset(len(keypoints), MAX_REGIONS)
    xy = np.asarray(keypoints[rows, :2], dtype=np.float64)
    shape = OUTLINE_SCALES * region_shapes(keypoints[rows])
    t = np.linspace(0.0, 2.0 * np.pi, 33)
    rings = xy[:, None] + np.einsum("kij,nj->kni", shape, np.column_stack([np.cos(t), np.sin(t)]))
    figure = _figure_of(pixels)
    axes = figure.subplots()
    _show(axes, pixels, f"{name}: {number(len(rows))} of {number(len(keypoints))} regions")
    axes.add_collection(
        PolyCollection(list(rings), facecolors="none", edgecolors=REGION_COLOR, linewidths=0.7)
    )
    radii = np.stack([xy, xy + shape[:, :, 0]], axis=1)
    axes.add_collection(LineCollection(list(radii), colors=REGION_COLOR, linewidths=0.7))
    return figure


def _shown_pair(data: FigureData) -> tuple[PairEvidence, list[Array]] | None:
    """The verified pair of neighbours nearest to the middle of the series, with its images."""
    evidence = data.inputs.evidence
    if evidence is None:
        return None
    place = {name: k for k, name in enumerate(data.frames.names)}
    middle = 0.5 * (len(place) - 1)

    def rank(pair: PairEvidence) -> tuple[bool, float, float]:
        at = [place[name] for name in pair.names]
        return not pair.verified.any(), abs(at[1] - at[0]), abs(sum(at) / 2.0 - middle)

    known = [p for p in evidence.pairs if all(n in place and n in evidence.images for n in p.names)]
    for pair in sorted(known, key=rank)[:1]:
        pixels = [pixels_of(evidence, name) for name in pair.names]
        if pixels[0] is not None and pixels[1] is not None:
            return pair, [pixels[0], pixels[1]]
    return None


def filtered_matches(data: FigureData) -> Figure | str:
    """Figure 4: the matches of a pair, as they were found and after each filter."""
    from matplotlib.collections import LineCollection

    if data.inputs.evidence is None:
        return NO_IMAGES
    found = _shown_pair(data)
    if found is None:
        return "no matches are known"
    pair, pixels = found
    keypoints = [data.inputs.evidence.images[name].keypoints for name in pair.names]
    xy = [
        np.asarray(k[pair.matches[:, side], :2], dtype=np.float64)
        for side, k in enumerate(keypoints)
    ]
    both, shift = _beside(pixels)
    lines = np.stack([xy[0], xy[1] + [shift, 0.0]], axis=1)
    steps = range(-1, len(MATCH_STEPS) - 1) if pair.steps_known else (-1, len(MATCH_STEPS) - 2)
    figure = _figure_of(both, columns=2, rows=(len(steps) + 1) // 2)
    panels = np.ravel(figure.subplots((len(steps) + 1) // 2, 2))
    some = np.zeros(len(lines), dtype=bool)
    some[even_subset(len(lines), MAX_LINES)] = True
    for axes, step in zip(panels, steps, strict=True):
        kept = pair.step > step
        dropped = (pair.step == step) if pair.steps_known else ~kept & (step >= 0)
        _show(axes, both, f"{_step_title(pair, step)}: {number(int(kept.sum()))}")
        for rows, color in ((kept, KEPT), (dropped, DROPPED)):
            # of what a filter dropped all are shown: it is little
            chosen = rows if color == DROPPED and rows.sum() <= MAX_LINES else rows & some
            axes.add_collection(LineCollection(list(lines[chosen]), colors=color, linewidths=0.6))
    return figure


def _step_title(pair: PairEvidence, step: int) -> str:
    if step < 0:
        return "found"
    return f"after {MATCH_STEPS[step]}" if pair.steps_known else "verified"


def _beside(pixels: Sequence[Array]) -> tuple[Array, int]:
    """Two images side by side, and how far the second is to the right."""
    gap = max(4, pixels[0].shape[1] // 60)
    height = max(p.shape[0] for p in pixels)
    shift = pixels[0].shape[1] + gap
    both = np.full((height, shift + pixels[1].shape[1]), 128, dtype=np.uint8)
    both[: pixels[0].shape[0], : pixels[0].shape[1]] = pixels[0]
    both[: pixels[1].shape[0], shift:] = pixels[1]
    return both, shift


def trajectories(data: FigureData) -> Figure | str:
    """Figure 5: where the points of the middle image are in the frames before and after it."""
    from matplotlib.collections import LineCollection

    found = _middle_image(data)
    rec, frames = data.inputs.reconstruction, data.frames
    if found is None:
        return NO_IMAGES
    _, name, pixels = found
    if not rec.inlier.any() or name not in rec.image_names:
        return "there are no kept observations"
    obs = rec.observations
    frame_of = np.zeros(rec.num_images, dtype=np.int64)
    frame_of[frames.image_idx] = frames.registered
    here = frames.names.index(name)
    frame = frame_of[obs.image_idx]
    seen = np.unique(obs.track_idx[rec.inlier & (frame == here)])
    chosen = seen[even_subset(len(seen), MAX_TRACKS)]
    near = rec.inlier & (np.abs(frame - here) <= REACH) & np.isin(obs.track_idx, chosen)
    rows = np.flatnonzero(near)
    rows = rows[np.lexsort((frame[rows], obs.track_idx[rows]))]
    same = obs.track_idx[rows[1:]] == obs.track_idx[rows[:-1]]
    lines: Float = np.stack([obs.xy[rows[:-1]], obs.xy[rows[1:]]], axis=1)[same]
    later = frame[rows[1:]][same] > here
    figure = _figure_of(pixels)
    axes = figure.subplots()
    title = f"{name}: {number(len(chosen))} of {number(len(seen))} tracks, ± {REACH} frames"
    _show(axes, pixels, title)
    for which, color in ((~later, BLUE), (later, RED)):
        axes.add_collection(LineCollection(list(lines[which]), colors=color, linewidths=0.8))
    places = obs.xy[rows[frame[rows] == here]]
    dots: dict[str, Any] = {"s": 3, "c": "white", "linewidths": 0, "zorder": 3}
    axes.scatter(places[:, 0], places[:, 1], **dots)
    return figure
