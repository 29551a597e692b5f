"""`semsfm export`: a project's model in the format of another program."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import tyro

from semsfm_colmap.bounds import CountOrNone
from semsfm_colmap.cli.common import Quiet, parse, positional_first, verbosity
from semsfm_colmap.exports.options import FormatOptions
from semsfm_colmap.exports.registry import FORMATS

DESCRIPTION = "Write the model of a project as another program reads it (docs/exports.md)."

Format = Annotated[
    str,
    tyro.conf.arg(
        constructor=tyro.extras.literal_type_from_choices(FORMATS),
        aliases=["--format"],
        help="; ".join(f"{name}: {entry.description}" for name, entry in FORMATS.items()),
    ),
]


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """Arguments of the command."""

    project_path: tyro.conf.Positional[Path]
    """The project folder; for stl and 3mf also the folder of a mesh of a COLMAP folder."""
    to: Format
    output_path: Path | None = None
    """Folder to write; default: PROJECT/export/FORMAT."""
    model: CountOrNone = 0
    """Number of the model below sparse/."""
    quiet: Quiet = False
    """Say nothing but warnings."""
    options: Annotated[FormatOptions, tyro.conf.arg(name="")] = field(default_factory=FormatOptions)


def main(arguments: Sequence[str]) -> None:
    """Run the command."""
    from semsfm_colmap.pipeline.export import export_project

    parsed = parse(Arguments, positional_first(arguments), "export", DESCRIPTION)
    target = parsed.output_path or parsed.project_path / "export" / parsed.to
    summary = export_project(
        parsed.project_path, parsed.to, target, model=parsed.model, options=parsed.options
    )
    reporter = verbosity(False, parsed.quiet)
    reporter.say(sentence(target, summary))
    for note in summary.get("notes", []):
        reporter.warn(note)


def sentence(target: Path, summary: dict[str, Any]) -> str:
    """What was written, in a line."""
    if "size_mm" in summary:
        size = " x ".join(f"{length:.3g}" for length in summary["size_mm"])
        return f"{target}: {summary['num_faces']} faces, {size} mm"
    text = f"{target}: {summary['num_images']} images, {summary['num_points']} points"
    if "num_depth_maps" in summary:
        text += f", {summary['num_depth_maps']} depth maps"
    if "focal_length_px" in summary:
        text += (
            f"; f = {summary['focal_length_px']:.3g} px, {summary['focal_factor']:.0f} image sides"
            f"; {summary['max_deviation_px']:.3g} px from parallel projection at most"
        )
    return text
