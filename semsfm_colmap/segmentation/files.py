"""PROJECT/segments: labelled copies of cloud, mesh and points, the table, the masks.

The copies hold every property of the file that they are made from, and `label`, an int, behind
them; the files themselves are not touched.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from semsfm_colmap.errors import InputError
from semsfm_colmap.io.ply import PlyFile, read_ply_file, write_ply_file
from semsfm_colmap.io.versions import check_version
from semsfm_colmap.segmentation.names import CLOUD_FILE, TABLE_FILE, TABLE_VERSION
from semsfm_colmap.types import Float, Int, PointCloud

LABEL = "label"
"""Name of the property."""


def positions(file: PlyFile) -> Float:
    """(V, 3) of the vertices of a file."""
    rows = file.vertices
    return np.stack([rows[name].astype(np.float64) for name in "xyz"], axis=1)


def write_labelled(file: PlyFile, label: Int, path: Path) -> None:
    """A copy of what a file holds, with a label for each vertex."""
    old = file.vertices.dtype
    kinds = [(name, old[name].str) for name in old.names or () if name != LABEL]
    rows = np.empty(len(file.vertices), dtype=[*kinds, (LABEL, "<i4")])
    for name, _ in kinds:
        rows[name] = file.vertices[name]
    rows[LABEL] = label
    write_ply_file(path, rows, file.faces, comment="semsfm_colmap, label: see segments.json")


def read_table(folder: Path) -> dict[str, Any]:
    """The content of segments.json.

    Raises
    ------
    InputError
        When there is no segmentation, or none that can be read.

    """
    path = folder / TABLE_FILE
    try:
        content: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(f"{path} is missing: run `semsfm segment {folder.parent}` first") from None
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise InputError(f"{path} cannot be read ({error}): run `semsfm segment` again") from error
    check_version(content, TABLE_VERSION, path, "run `semsfm segment` again")
    return content


def select_part(cloud: PointCloud, folder: Path, name: str) -> PointCloud:
    """The points of one part of a cloud, as the labels in `folder` say.

    Raises
    ------
    InputError
        When there is no segmentation, none of this cloud, or no such part in it.

    """
    parts = {part["name"]: part["label"] for part in read_table(folder)["parts"]}
    if name not in parts:
        raise InputError(
            f"{folder / TABLE_FILE} knows no part named {name}: the parts are {', '.join(parts)}"
        )
    file = read_ply_file(folder / CLOUD_FILE)
    same = LABEL in (file.vertices.dtype.names or ()) and len(file.vertices) == len(cloud.points)
    if not same or not np.array_equal(positions(file), cloud.points):
        raise InputError(
            f"{folder / CLOUD_FILE} labels another cloud than dense/fused.ply: run "
            f"`semsfm segment {folder.parent}` again"
        )
    return cloud.select(file.vertices[LABEL] == parts[name])
