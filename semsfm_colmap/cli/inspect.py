"""`semsfm inspect`: what the image files say, and whether they will do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from shutil import get_terminal_size
from typing import Annotated

import tyro

from semsfm_colmap.cli.common import parse, positional_first
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.io.printable import printable

DESCRIPTION = "A table of the image files (size, pixel size, tilt, warnings) and a verdict."


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """Arguments of the command."""

    image_path: tyro.conf.Positional[Path]
    """Folder with the images, or an MRC stack."""
    json: Path | None = None
    """Also write one object an image to this file."""
    csv: Path | None = None
    """Also write one row an image to this file."""
    ingest: Annotated[IngestOptions, tyro.conf.arg(name="")] = field(default_factory=IngestOptions)


def main(arguments: Sequence[str]) -> None:
    """Run the command."""
    from semsfm_colmap.ingest.inspect.files import write_inspection_csv, write_inspection_json
    from semsfm_colmap.ingest.inspect.inspection import inspect_images
    from semsfm_colmap.ingest.inspect.text import WIDTH, format_inspection
    from semsfm_colmap.pipeline.reporter import Reporter

    parsed = parse(Arguments, positional_first(arguments), "inspect", DESCRIPTION)
    with Reporter().progress("reading images") as progress:
        inspection = inspect_images(parsed.image_path, parsed.ingest, progress=progress)
    text = format_inspection(inspection, get_terminal_size((WIDTH, 24)).columns)
    print(printable(text, keep="\n\t"), end="")
    if parsed.json is not None:
        write_inspection_json(inspection, parsed.json)
    if parsed.csv is not None:
        write_inspection_csv(inspection, parsed.csv)
