"""`semsfm reconstruct`: images to COLMAP project, mesh and report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import tyro

from semsfm_colmap.cli.common import (
    Flattened,
    Quiet,
    Verbose,
    output_config,
    parse,
    positional_first,
    verbosity,
    with_default_config,
)
from semsfm_colmap.config import Config

DESCRIPTION = "A folder of SEM images becomes a COLMAP project, a mesh and a report."


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """Arguments of the command."""

    image_path: tyro.conf.Positional[Path]
    """Folder with the images, named in the order of the tilt or rotation, or an MRC stack."""
    output_path: Path
    """The project folder; a second run keeps what has not changed."""
    config_path: Path | None = None
    """TOML file with options; default: those that the project was made with. Flags override it."""
    force: bool = False
    """Run every stage even when nothing has changed."""
    verbose: Verbose = False
    """Say more."""
    quiet: Quiet = False
    """Say nothing but warnings."""
    config: Flattened = field(default_factory=Config)


@dataclass(frozen=True, kw_only=True)
class ReconstructArguments(Arguments):
    """Arguments of the whole reconstruction."""

    database_path: Path | None = None
    """A COLMAP database with features and matches of the images, used in place of our own; it is
    not changed."""


def main(arguments: Sequence[str]) -> None:
    """Run the command."""
    from semsfm_colmap.pipeline.foreign.import_database import reconstruct_from_database
    from semsfm_colmap.pipeline.project import Project
    from semsfm_colmap.pipeline.registry import STAGE_NAMES
    from semsfm_colmap.pipeline.runner import run_stages
    from semsfm_colmap.pipeline.summary import say_summary

    args = positional_first(arguments)
    command = with_default_config(ReconstructArguments, output_config(args))
    parsed = parse(command, args, "reconstruct", DESCRIPTION)
    reporter = verbosity(parsed.verbose, parsed.quiet)
    if parsed.database_path is not None:
        record = reconstruct_from_database(
            parsed.image_path,
            parsed.database_path,
            parsed.output_path,
            parsed.config,
            reporter=reporter,
            force=parsed.force,
        )
    else:
        record = run_stages(
            parsed.output_path,
            parsed.config,
            image_path=parsed.image_path,
            reporter=reporter,
            force=parsed.force,
        )
    if not parsed.quiet:
        say_summary(Project(parsed.output_path), record, STAGE_NAMES, reporter)
