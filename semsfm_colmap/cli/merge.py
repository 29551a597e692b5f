"""`semsfm merge`: several series of one specimen in one model."""

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
    parse_flags,
    verbosity,
    with_default_config,
)
from semsfm_colmap.config import Config

DESCRIPTION = (
    "Several series of one specimen in one model: turned about other axes, mounted anew, at "
    "another magnification. The result is an ordinary project."
)


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """Arguments of the command."""

    project_paths: tyro.conf.Positional[tuple[Path, ...]]
    """The projects of the series; the pixel size is that of the first."""
    output_path: Path
    """The new project folder."""
    config_path: Path | None = None
    """TOML file with options; default: those that the project was made with. Flags override it."""
    force: bool = False
    """Run even when nothing has changed."""
    verbose: Verbose = False
    """Say more."""
    quiet: Quiet = False
    """Say nothing but warnings."""
    config: Flattened = field(default_factory=Config)


def main(arguments: Sequence[str]) -> None:
    """Run the command."""
    from semsfm_colmap.pipeline.merge import merge_projects

    args = list(arguments)
    command = with_default_config(Arguments, output_config(args))
    parsed = parse_flags(command, args, "merge", DESCRIPTION)
    merge_projects(
        parsed.project_paths,
        parsed.output_path,
        parsed.config,
        reporter=verbosity(parsed.verbose, parsed.quiet),
        force=parsed.force,
    )
