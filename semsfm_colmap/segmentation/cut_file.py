"""segments.toml: the cuts of a project, one line each, so that deleting a line takes one back.

Behind them are the cameras of the models that boxes, spheres and planes are coordinates of
(`world.py`), each model once; ``world`` of a cut is the number of its model, from 0.
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np

from semsfm_colmap.errors import UsageError
from semsfm_colmap.io.atomic import write_text
from semsfm_colmap.segmentation.cuts import NUM_VALUES, TEXTS, Cut, CutKind
from semsfm_colmap.segmentation.names import DROPPED, NAMES
from semsfm_colmap.segmentation.world import World, WorldCamera

HEAD = "# Cuts of `semsfm segment`, in their order; delete a line to take a cut back.\n"
WORLDS_HEAD = (
    "\n# Cameras of the models whose coordinates the cuts are in: another model is told by them.\n"
)


def read_cuts(path: Path) -> list[Cut]:
    """The cuts of a file; none where there is no file.

    Raises
    ------
    UsageError
        Which entry is wrong, and what is expected.

    """
    if not path.is_file():
        return []
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise UsageError(f"{path} is not valid TOML: {error}") from error
    entries, worlds = content.get("cuts", []), content.get("worlds", [])
    for name, value in (("cuts", entries), ("worlds", worlds)):
        if not isinstance(value, list):
            raise UsageError(f"{path}: {name} = {value!r}, but a list is expected")
    known = [_parsed_world(world, f"{path}: world {k}") for k, world in enumerate(worlds)]
    return [_parsed(entry, known, f"{path}: cut {k + 1}") for k, entry in enumerate(entries)]


def write_cuts(cuts: Sequence[Cut], path: Path) -> None:
    """Write the cuts, one line each, and the worlds that they are in."""
    worlds = list(dict.fromkeys(cut.world for cut in cuts if cut.world))
    lines = "".join(f"  {_line(cut, worlds)},\n" for cut in cuts)
    text = f"{HEAD}cuts = [\n{lines}]\n"
    if worlds:
        text += f"{WORLDS_HEAD}worlds = [\n{''.join(map(_world_lines, worlds))}]\n"
    write_text(text, path)


def check_cut(cut: Cut, where: str) -> Cut:
    """The cut itself, if it can be.

    Raises
    ------
    UsageError
        When the number of values or their order makes no shape.

    """
    wanted = NUM_VALUES.get(cut.kind, 0)
    v = np.asarray(cut.values, dtype=np.float64)
    if len(v) != wanted or not np.isfinite(v).all():
        raise UsageError(f"{where}: {cut.kind} takes {wanted} finite numbers, not {list(v)}")
    if cut.kind == "box" and np.any(v[:3] >= v[3:]):
        raise UsageError(f"{where}: the upper corner {v[3:]} of the box is not above {v[:3]}")
    if cut.kind == "sphere" and v[3] <= 0:
        raise UsageError(f"{where}: the sphere has radius {v[3]:g}: give a positive one")
    if cut.kind == "plane" and not v[:3].any():
        raise UsageError(f"{where}: the plane has no normal: a, b and c are all 0")
    if cut.kind in TEXTS and not cut.text:
        raise UsageError(
            f"{where}: {cut.kind} needs the name of a {'folder' if cut.kind == 'masks' else 'part'}"
        )
    if not cut.label:
        raise UsageError(f"{where}: the label is empty")
    return cut


def _parsed(entry: Any, worlds: Sequence[World], where: str) -> Cut:
    kinds = [*NUM_VALUES, *TEXTS]
    if not isinstance(entry, dict) or len(found := [k for k in kinds if k in entry]) != 1:
        raise UsageError(f"{where} must name one of {', '.join(kinds)}, but is {entry!r}")
    unknown = set(entry) - {found[0], "label", "outside", "world"}
    if unknown:
        raise UsageError(f"{where}: unknown key {min(unknown)}")
    kind, value = cast(CutKind, found[0]), entry[found[0]]
    world: World = ()
    number = entry.get("world")
    if number is not None:
        if not isinstance(number, int) or not 0 <= number < len(worlds):
            raise UsageError(f"{where}: world = {number!r}, but the file has {len(worlds)} worlds")
        world = worlds[number]
    label, outside = entry.get("label", NAMES[DROPPED]), entry.get("outside", False)
    if not isinstance(label, str) or not isinstance(outside, bool):
        raise UsageError(f"{where}: label is a name and outside is true or false")
    if kind in TEXTS:
        if not isinstance(value, str):
            raise UsageError(f"{where}: {kind} = {value!r}, but a text is expected")
        return check_cut(Cut(kind=kind, text=value, label=label, outside=outside), where)
    try:
        values = tuple(float(number) for number in value)
    except (TypeError, ValueError):
        raise UsageError(f"{where}: {kind} = {value!r}, but numbers are expected") from None
    return check_cut(
        Cut(kind=kind, values=values, label=label, outside=outside, world=world), where
    )


def _parsed_world(entry: Any, where: str) -> World:
    try:
        cameras = [
            (one["image"], tuple(float(number) for number in one["camera"])) for one in entry
        ]
        if all(isinstance(image, str) and len(camera) == 8 for image, camera in cameras):
            return tuple(WorldCamera(image=image, camera=camera) for image, camera in cameras)
    except (TypeError, KeyError, ValueError):
        pass
    raise UsageError(
        f"{where} must be a list of {{ image = NAME, camera = [8 numbers] }}: leave what is in "
        "`worlds` as it was written, or delete all of it and `world` from the cuts"
    )


def _world_lines(world: World) -> str:
    rows = "".join(
        f"    {{ image = {json.dumps(one.image)}, camera = {json.dumps(list(one.camera))} }},\n"
        for one in world
    )
    return f"  [\n{rows}  ],\n"


def _line(cut: Cut, worlds: Sequence[World]) -> str:
    # texts are written as JSON writes them, which TOML reads alike
    value = json.dumps(cut.text) if cut.kind in TEXTS else json.dumps(list(cut.values))
    parts = [f"{cut.kind} = {value}"]
    if cut.kind not in ("keep", "drop"):
        parts.append(f"label = {json.dumps(cut.label)}")
    if cut.outside:
        parts.append("outside = true")
    if cut.world:
        parts.append(f"world = {worlds.index(cut.world)}")
    return "{ " + ", ".join(parts) + " }"
