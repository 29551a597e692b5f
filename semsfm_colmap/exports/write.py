"""One export: names checked, written aside, stated in export.json, put in place as a whole."""

from __future__ import annotations

import csv
import json
from pathlib import Path

from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.exports.names import check_names
from semsfm_colmap.exports.options import FormatOptions
from semsfm_colmap.exports.printing import FILE_TYPES, print_mesh
from semsfm_colmap.exports.registry import find_format
from semsfm_colmap.exports.scene import ExportScene, Summary
from semsfm_colmap.io.atomic import folder_aside
from semsfm_colmap.io.csv_cells import safe_rows

STATEMENT = "export.json"


def export_scene(
    scene: ExportScene, format_name: str, output_path: Path, options: FormatOptions
) -> Summary:
    """Write a scene in one format; an older export in the same place is replaced as a whole.

    Returns
    -------
    what export.json says: format, numbers of images and points, and for pinhole formats the focal
    length and ``max_deviation_px``, the largest distance to the parallel projection that was
    reached over all observations

    """
    chosen = find_format(format_name)
    check_names(scene.names, chosen.name_rule, format_name)
    if len(scene.names) == 0:
        raise InputError("the model has no registered image: map the series first")
    check_place(output_path)
    with folder_aside(output_path) as aside:
        summary = {"format": format_name, **chosen.writer()(scene, aside, options)}
        renamed = scene.names != scene.reconstruction.image_names
        if renamed:
            _write_names(scene, aside / "names.csv")
            if not chosen.copies_images:
                scene.copy_images(aside / "images")
        _state(summary, aside)
    return summary


def export_mesh(
    mesh_path: Path, format_name: str, output_path: Path, options: FormatOptions, unit: str
) -> Summary:
    """Write a mesh.ply that no project belongs to for printing; otherwise as `export_scene`.

    Parameters
    ----------
    unit : of its world, empty where it is not known

    """
    find_format(format_name)
    if format_name not in FILE_TYPES:
        raise UsageError(
            f"{mesh_path.parent} is the mesh of a COLMAP folder, not a project: it is exported to "
            f"{' or '.join(FILE_TYPES)}"
        )
    check_place(output_path)
    with folder_aside(output_path) as aside:
        printed = print_mesh(mesh_path, aside, options, format_name, unit)
        summary = {"format": format_name, **printed}
        _state(summary, aside)
    return summary


def _state(summary: Summary, folder: Path) -> None:
    text = json.dumps(summary, indent=1, default=float)
    (folder / STATEMENT).write_text(text + "\n", encoding="utf-8")


def check_place(output_path: Path) -> None:
    """Refuse a place that holds anything but an export of ours."""
    if output_path.is_file():
        raise UsageError(f"{output_path} is a file: give a folder as --output_path")
    occupied = output_path.is_dir() and any(output_path.iterdir())
    if occupied and not (output_path / STATEMENT).is_file():
        raise UsageError(
            f"{output_path} holds files that `semsfm export` did not write: give another "
            "--output_path, so that nothing is overwritten"
        )


def _write_names(scene: ExportScene, path: Path) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["export", "project"])
        rows.writerows(safe_rows(zip(scene.names, scene.reconstruction.image_names, strict=True)))
