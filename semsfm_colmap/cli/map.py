"""`semsfm map`: one stage on a project folder, or any COLMAP database as `colmap mapper` does."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from semsfm_colmap.cli.common import (
    Flattened,
    Quiet,
    Verbose,
    file_config,
    parse_flags,
    positional_first,
    run_stage_command,
    verbosity,
    with_default_config,
)
from semsfm_colmap.cli.help_page import help_alone
from semsfm_colmap.config import Config
from semsfm_colmap.errors import UsageError
from semsfm_colmap.io.layout import (
    DATABASE_FILE,
    IMAGES_FOLDER,
    LOCK_FILE,
    RECORD_FILE,
    SERIES_FILE,
)

DESCRIPTION = """Cameras and points from the verified matches of a project. Also

  semsfm map --database_path DATABASE --image_path IMAGES --output_path MODELS

on any COLMAP database, as `colmap mapper`; `semsfm map --database_path --help` has its options."""


OUTPUT_FOLDER = "sparse_semsfm"
"""Where models of another program's folder go, beside its own."""


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
        refuse_workspace(arguments)
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


def refuse_workspace(arguments: Sequence[str]) -> None:
    """Say what to type for a folder that COLMAP made, which has a database but is no project."""
    args = positional_first(arguments)
    folder = Path(args[0]) if args and not args[0].startswith("-") else None
    if folder is None or not (folder / DATABASE_FILE).is_file():
        return
    if any((folder / name).is_file() for name in (RECORD_FILE, SERIES_FILE, LOCK_FILE)):
        return
    words = ["semsfm", "map", "--database_path", str(folder / DATABASE_FILE)]
    if (folder / IMAGES_FOLDER).is_dir():
        words += ["--image_path", str(folder / IMAGES_FOLDER)]
    words += ["--output_path", str(folder / OUTPUT_FOLDER)]
    raise UsageError(
        f"{folder} is no project of semsfm but another program's, with a {DATABASE_FILE}: type "
        f"`{shlex.join(words)}`, which leaves what is there as it is"
    )
