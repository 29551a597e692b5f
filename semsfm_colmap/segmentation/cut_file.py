"""segments.toml: the cuts of a project, one line each, so that deleting a line takes one back."""

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

HEAD = "# Cuts of `semsfm segment`, in their order; delete a line to take a cut back.\n"


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
        entries = tomllib.loads(path.read_text(encoding="utf-8")).get("cuts", [])
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise UsageError(f"{path} is not valid TOML: {error}") from error
    if not isinstance(entries, list):
        raise UsageError(f"{path}: cuts = {entries!r}, but a list is expected")
    return [_parsed(entry, f"{path}: cut {k + 1}") for k, entry in enumerate(entries)]


def write_cuts(cuts: Sequence[Cut], path: Path) -> None:
    """Write the cuts, one line each."""
    lines = "".join(f"  {_line(cut)},\n" for cut in cuts)
    write_text(f"{HEAD}cuts = [\n{lines}]\n", path)


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


def _parsed(entry: Any, where: str) -> Cut:
    kinds = [*NUM_VALUES, *TEXTS]
    if not isinstance(entry, dict) or len(found := [k for k in kinds if k in entry]) != 1:
        raise UsageError(f"{where} must name one of {', '.join(kinds)}, but is {entry!r}")
    unknown = set(entry) - {found[0], "label", "outside"}
    if unknown:
        raise UsageError(f"{where}: unknown key {min(unknown)}")
    kind, value = cast(CutKind, found[0]), entry[found[0]]
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
    return check_cut(Cut(kind=kind, values=values, label=label, outside=outside), where)


def _line(cut: Cut) -> str:
    # texts are written as JSON writes them, which TOML reads alike
    value = json.dumps(cut.text) if cut.kind in TEXTS else json.dumps(list(cut.values))
    parts = [f"{cut.kind} = {value}"]
    if cut.kind not in ("keep", "drop"):
        parts.append(f"label = {json.dumps(cut.label)}")
    if cut.outside:
        parts.append("outside = true")
    return "{ " + ", ".join(parts) + " }"
