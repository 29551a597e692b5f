"""`semsfm map`: one stage on a project folder, or any COLMAP database as `colmap mapper` does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from semsfm_colmap.cli.common import (
    Flattened,
    Quiet,
    Verbose,
    file_config,
    parse_flags,
    run_stage_command,
    verbosity,
    with_default_config,
)
from semsfm_colmap.cli.help_page import help_alone
from semsfm_colmap.config import Config

DESCRIPTION = """Cameras and points from the verified matches of a project. Also

  semsfm map --database_path DATABASE --image_path IMAGES --output_path MODELS

on any COLMAP database, as `colmap mapper`; `semsfm map --database_path --help` has its options."""


@dataclass(frozen=True, kw_only=True)
class DatabaseArguments:
    """Arguments of the command on a database."""

    database_path: Path
    """A COLMAP database with keypoints and matches (schema 3.8 or 4.x); it is not changed."""
    output_path: Path
    """Folder for the models 0, 1, ..."""
    image_path: Path | None = None
    """Folder with the images the database was made from; gives the points their grey values."""
    config_path: Path | None = None
    """TOML file with options; flags override it."""
    verbose: Verbose = False
    """Say more."""
    quiet: Quiet = False
    """Say nothing but warnings."""
    config: Flattened = field(default_factory=Config)


def main(arguments: Sequence[str]) -> None:
    """Run the command."""
    if not any(a.split("=")[0] == "--database_path" for a in arguments):
        run_stage_command("map", ("map",), arguments, DESCRIPTION)
        return
    args = list(arguments)
    args = help_alone(args)
    command = with_default_config(DatabaseArguments, file_config(args))
    parsed = parse_flags(command, args, "map", "Cameras and points from any COLMAP database.")
    from semsfm_colmap.pipeline.foreign.map_database import map_database

    map_database(
        parsed.database_path,
        parsed.output_path,
        parsed.config,
        image_path=parsed.image_path,
        reporter=verbosity(parsed.verbose, parsed.quiet),
    )
