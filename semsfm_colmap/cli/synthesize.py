"""`semsfm synthesize`: render an SEM-like series with exact truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from semsfm_colmap.cli.common import Quiet, parse, verbosity
from semsfm_colmap.synthetic.options import SynthesizeOptions, example_options

DESCRIPTION = "Render an SEM-like series of a synthetic specimen, with exact truth beside it."


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """Arguments of the command."""

    output_path: tyro.conf.Positional[Path]
    """Folder that will hold images/, truth.json, truth.npz and mesh.npz."""
    quiet: Quiet = False
    """Show no progress."""
    options: Annotated[SynthesizeOptions, tyro.conf.arg(name="")] = field(
        default_factory=SynthesizeOptions
    )


@dataclass(frozen=True, kw_only=True)
class ExampleArguments(Arguments):
    """The same, starting from the small example."""

    options: Annotated[SynthesizeOptions, tyro.conf.arg(name="")] = field(
        default_factory=example_options
    )


def main(arguments: Sequence[str]) -> None:
    """Run the command; ``--example`` starts from the small example of the README."""
    from semsfm_colmap.synthetic.series import synthesize

    args = [a for a in arguments if a != "--example"]
    command = ExampleArguments if len(args) < len(arguments) else Arguments
    parsed = parse(
        command, args, "synthesize", DESCRIPTION + " --example: the small one of the README."
    )
    reporter = verbosity(False, parsed.quiet)
    with reporter.progress("rendering") as progress:
        synthesize(parsed.output_path, parsed.options, progress)
    reporter.say(f"{parsed.output_path}: images/, truth.json, truth.npz, mesh.npz")
