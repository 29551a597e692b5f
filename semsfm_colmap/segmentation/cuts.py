"""Cuts made by hand: what they are, and what they do to a labelling.

A cut gives a label, "dropped" unless another is named, to the points that it takes:

- box: ``lower <= x <= upper``;
- sphere: ``|x - centre| <= radius``;
- plane: ``a x + b y + c z > d``, one side of it;
- masks: points that masks in COLMAP's convention leave out (0) in more than half of the images
  that face them (``n . d < 0``, d the viewing direction) and show them;
- keep: all parts but one; drop: one part.

`outside` turns box, sphere, plane and masks round. Cuts follow one another in their order; no point
is ever removed. The coordinates of a box, a sphere or a plane are those of the model that they were
made in, its `world`; points go there before they are compared.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from semsfm_colmap.errors import InputError
from semsfm_colmap.geometry.alignment import Similarity
from semsfm_colmap.io.grey import read_mask
from semsfm_colmap.segmentation.labels import Labelling
from semsfm_colmap.segmentation.names import DROPPED, NAMES
from semsfm_colmap.segmentation.world import World
from semsfm_colmap.types import Bool, Float, Int, OrthographicCameras, PointCloud

CutKind = Literal["box", "sphere", "plane", "masks", "keep", "drop"]
NUM_VALUES: dict[str, int] = {"box": 6, "sphere": 4, "plane": 4}
"""Numbers that describe a shape, in world units."""
TEXTS = ("masks", "keep", "drop")
"""Kinds described by a folder or by the name of a part."""


@dataclass(frozen=True, kw_only=True)
class Cut:
    """One cut."""

    kind: CutKind
    values: tuple[float, ...] = ()
    """box: lower x y z, upper x y z; sphere: centre, radius; plane: a b c d"""
    text: str = ""
    """masks: the folder; keep, drop: the name of a part"""
    label: str = NAMES[DROPPED]
    """the name that what it takes is given"""
    outside: bool = False
    world: World = ()
    """box, sphere, plane: what they are coordinates of"""


@dataclass(frozen=True, kw_only=True, eq=False)
class Views:
    """The images that masks belong to, M of them."""

    names: tuple[str, ...]
    cameras: OrthographicCameras


def apply_cuts(
    labelling: Labelling,
    cloud: PointCloud,
    views: Views,
    cuts: Sequence[Cut],
    model_from_world: Mapping[World, Similarity] | None = None,
) -> Labelling:
    """The labelling after all cuts, in their order.

    Parameters
    ----------
    labelling, cloud : N points
    views : the images of the model
    cuts : their shapes in coordinates of their worlds
    model_from_world : from those to the model; what is not in it is the model's own

    Raises
    ------
    InputError
        When a cut names a part that there is not, or a folder without masks.

    """
    for cut in cuts:
        x = np.asarray(cloud.points)
        if model_from_world is not None and cut.world in model_from_world:
            x = model_from_world[cut.world].inverse.apply(x)
        taken = _taken(labelling, cloud, x, views, cut)
        names = dict(labelling.names)
        number = next((n for n, name in names.items() if name == cut.label), None)
        if number is None:
            number = max(*names, *NAMES) + 1
            names[number] = cut.label
        labelling = replace(
            labelling,
            label=np.where(taken, number, labelling.label),
            confidence=np.where(taken, 1.0, labelling.confidence),
            names=names,
        )
    return labelling


def _taken(labelling: Labelling, cloud: PointCloud, x: Float, views: Views, cut: Cut) -> Bool:
    """(N,) the points that a cut takes; x (N, 3), the points in its world."""
    v = np.asarray(cut.values)
    if cut.kind in ("keep", "drop"):
        known = sorted(labelling.names[k] for k in np.unique(labelling.label))
        if cut.text not in known:
            raise InputError(
                f"there is no part named {cut.text} to {cut.kind}: the parts are {', '.join(known)}"
            )
        part = labelling.is_part(cut.text)
        return ~part if cut.kind == "keep" else part
    if cut.kind == "box":
        taken = np.all((x >= v[:3]) & (x <= v[3:]), axis=1)
    elif cut.kind == "sphere":
        taken = np.linalg.norm(x - v[:3], axis=1) <= v[3]
    elif cut.kind == "plane":
        taken = x @ v[:3] > v[3]
    else:
        taken = left_out(cloud, views, Path(cut.text))
    return ~taken if cut.outside else taken


def left_out(cloud: PointCloud, views: Views, folder: Path) -> Bool:
    """Points that masks leave out in more than half of the images that face and show them: (N,)."""
    x = np.asarray(cloud.points)
    shown, out = np.zeros(len(x), dtype=np.int64), np.zeros(len(x), dtype=np.int64)
    num_masks = 0
    for i, name in enumerate(views.names):
        mask = read_mask(folder, name)
        if mask is None:
            continue
        num_masks += 1
        uv = x @ views.cameras.projection[i].T + views.cameras.translation_px[i]
        pixel: Int = np.floor(uv).astype(np.int64)
        inside = np.all((pixel >= 0) & (pixel < mask.shape[::-1]), axis=1)
        if cloud.normals is not None:
            inside &= _facing(cloud.normals, views.cameras.viewing_direction[i])
        rows = np.flatnonzero(inside)
        shown[rows] += 1
        out[rows] += ~mask[pixel[rows, 1], pixel[rows, 0]]
    if num_masks == 0:
        raise InputError(
            f"{folder} holds no mask of these images: masks are named <image name>.png, "
            f"such as {views.names[0]}.png"
        )
    return np.asarray(2 * out > shown)


def _facing(normals: Float, direction: Float) -> Bool:
    return np.asarray(normals @ direction < 0)
