"""What the subcommands share: flags from the configuration, precedence, verbosity."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, TypeVar

import tyro

from semsfm_colmap.cli.help_page import ALL, asked, page
from semsfm_colmap.config import Config, preset, read_config
from semsfm_colmap.errors import UsageError
from semsfm_colmap.pipeline.reporter import Reporter
from semsfm_colmap.presets import QUALITIES

T = TypeVar("T")

SHORT_FLAGS = {
    "--depth_sign": "--refinement.depth_sign",
    "--series": "--series_csv",
    "--segment": "--segmentation.part",
}
"""Flags that may be written short."""

DESCRIBE = "\0describe"
"""No argument that a person types: asks a command for its flags, see `described`."""
A = TypeVar("A", bound="StageArguments")

Flattened = Annotated[Config, tyro.conf.arg(name="")]
Verbose = Annotated[bool, tyro.conf.arg(aliases=["-v"])]
Quiet = Annotated[bool, tyro.conf.arg(aliases=["-q"])]


class Described(SystemExit):
    """Ends the parsing of a command's arguments with the dataclass that holds its flags."""

    def __init__(self, command: type[Any]) -> None:
        super().__init__(command.__name__)
        self.command = command


def described(main: Callable[[Sequence[str]], None]) -> type[Any]:
    """The dataclass of a command's flags, given the function that runs it."""
    try:
        main([DESCRIBE])
    except Described as answer:
        return answer.command
    raise AssertionError("a command parses its arguments before anything else")


@dataclass(frozen=True, kw_only=True)
class StageArguments:
    """Arguments of a command that works on a project."""

    project_path: tyro.conf.Positional[Path]
    """The project folder."""
    config_path: Path | None = None
    """TOML file with options; default: the project's semsfm.toml. Flags override it."""
    force: bool = False
    """Run even when nothing has changed."""
    verbose: Verbose = False
    """Say more."""
    quiet: Quiet = False
    """Say nothing but warnings."""
    config: Flattened = field(default_factory=Config)


def parse(command: type[T], arguments: Sequence[str], name: str, description: str) -> T:
    """Parse arguments with the positional one first, or given as a flag as COLMAP does."""
    return parse_flags(command, positional_first(arguments), name, description)


def parse_flags(command: type[T], arguments: Sequence[str], name: str, description: str) -> T:
    """Parse arguments into a dataclass, flags in COLMAP's spelling (underscores).

    Help that is asked for is printed, and ends the program; so does `Described` where the flags are
    asked for.
    """
    if DESCRIBE in arguments:
        raise Described(command)
    wanted = asked(arguments)
    if wanted is not None and wanted != ALL[0]:
        print(page(command, name, description, wanted))
        raise SystemExit(0)
    return tyro.cli(
        command,
        args=["--help"] if wanted == ALL[0] else with_full_flags(arguments),
        prog=f"semsfm {name}",
        description=description,
        use_underscores=True,
    )


def with_full_flags(arguments: Sequence[str]) -> list[str]:
    """Write out the flags of `SHORT_FLAGS`."""
    args = list(arguments)
    for short, full in SHORT_FLAGS.items():
        args = [full + a[len(short) :] if a.split("=")[0] == short else a for a in args]
    return args


def positional_first(arguments: Sequence[str]) -> list[str]:
    """Accept ``--image_path X`` and ``--project_path X`` for the positional argument, as COLMAP."""
    args = with_full_flags(arguments)
    for flag in ("--image_path", "--project_path"):
        for k, argument in enumerate(args):
            if argument == flag and k + 1 < len(args):
                value = args[k + 1]
                return [value, *args[:k], *args[k + 2 :]]
            if argument.startswith(flag + "="):
                return [argument.split("=", 1)[1], *args[:k], *args[k + 1 :]]
    return args


def verbosity(verbose: bool, quiet: bool) -> Reporter:
    """A reporter that says as much as was asked for."""
    return Reporter(verbosity=-1 if quiet else 1 if verbose else 0)


def flag_value(arguments: Sequence[str], flag: str) -> str | None:
    """The value of a flag, given as ``--flag X`` or ``--flag=X``; None where it is not given."""
    for k, argument in enumerate(arguments):
        if argument == flag and k + 1 < len(arguments):
            return arguments[k + 1]
        if argument.startswith(flag + "="):
            return argument.split("=", 1)[1]
    return None


def output_config(arguments: Sequence[str]) -> Config:
    """As `file_config` of the project at ``--output_path``, where there is one already."""
    path = flag_value(arguments, "--output_path")
    quiet = "-q" in arguments or "--quiet" in arguments
    return file_config(
        arguments, None if path is None else Path(path), Reporter(verbosity=-1 if quiet else 0)
    )


def file_config(
    arguments: Sequence[str], project_path: Path | None = None, reporter: Reporter | None = None
) -> Config:
    """The configuration before flags: ``--config_path``, else the project's, else defaults.

    ``--quality`` comes before all three: what they say of single options stands above it.

    Parameters
    ----------
    reporter : told which options are the project's

    """
    from semsfm_colmap.pipeline.project import Project
    from semsfm_colmap.pipeline.project_options import read_project_options

    given = flag_value(arguments, "--quality")
    quality = next((known for known in QUALITIES if known == given), None)
    path = flag_value(arguments, "--config_path")
    if path is not None:
        return read_config(Path(path), quality)
    if project_path is not None and DESCRIBE not in arguments and asked(arguments) is None:
        kept = read_project_options(Project(project_path), quality, reporter)
        if kept is not None:
            return kept
    return Config() if quality is None else preset(quality)


def with_default_config(command: type[Any], config: Config) -> type[Any]:
    """The command with another default configuration, so that flags override a file."""
    from dataclasses import make_dataclass

    return make_dataclass(
        command.__name__,
        [("config", Flattened, field(default_factory=lambda: config))],
        bases=(command,),
        frozen=True,
        kw_only=True,
    )


def run_stage_command(
    name: str,
    stages: Sequence[str],
    arguments: Sequence[str],
    description: str,
    kind: type[A] = StageArguments,  # type: ignore[assignment]
) -> A:
    """A command that runs some stages of an existing project; its arguments, of `kind`."""
    from semsfm_colmap.pipeline.project import Project
    from semsfm_colmap.pipeline.runner import run_stages
    from semsfm_colmap.pipeline.summary import say_summary

    args = positional_first(arguments)
    project = Path(args[0]) if args and not args[0].startswith("-") else None
    command = with_default_config(kind, file_config(args, project))
    parsed: A = parse(command, args, name, description)
    if not parsed.project_path.is_dir():
        raise UsageError(f"{parsed.project_path} is not a folder: give a project folder")
    reporter = verbosity(parsed.verbose, parsed.quiet)
    record = run_stages(
        parsed.project_path, parsed.config, names=stages, reporter=reporter, force=parsed.force
    )
    if not parsed.quiet:
        say_summary(Project(parsed.project_path), record, stages, reporter)
    return parsed
