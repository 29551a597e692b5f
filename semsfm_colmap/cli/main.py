"""Entry point of `semsfm`: finds the subcommand, turns errors into a sentence and an exit code."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from semsfm_colmap.cli.commands import COMMANDS, find_command
from semsfm_colmap.cli.help_texts import GROUPS
from semsfm_colmap.io.terminal import tell

INTERRUPTED = 130
TERMINATED = 143
"""Exit codes of programs that SIGINT and SIGTERM end, as shells give them."""
BROKEN_PIPE = 141
"""Exit code of a program that SIGPIPE ends, as shells give it."""


def usage() -> str:
    """The text of `semsfm --help`: the commands by purpose."""
    width = max(len(command.name) for command in COMMANDS)
    by_name = {command.name: command for command in COMMANDS}
    named = {name for _, names in GROUPS for name in names}
    groups = [*GROUPS, ("others", tuple(name for name in by_name if name not in named))]
    lines = []
    for purpose, names in groups:
        known = [by_name[name] for name in names if name in by_name]
        if known:
            lines += [f"{purpose}:", *(f"  {c.name:<{width}}  {c.help}" for c in known), ""]
    return "\n".join(
        [
            "usage: semsfm COMMAND [options]",
            "",
            "3-D reconstruction from scanning electron microscope images (parallel projection).",
            "",
            "  semsfm inspect IMAGES",
            "  semsfm reconstruct IMAGES --output_path PROJECT",
            "",
            *lines,
            "`semsfm COMMAND --help` has examples and the options used first, --help-all all of",
            "them, --help SECTION those of a section; `semsfm --version` says the version.",
        ]
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one subcommand; returns 0 done, 1 the data do not allow it, 2 usage."""
    args = list(sys.argv[1:] if arguments is None else arguments)
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # a program may be started without
            setattr(sys, name, Path(os.devnull).open("w", encoding="utf-8"))  # noqa: SIM115
        stream = getattr(sys, name)
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # not every terminal has a micro sign
    try:
        try:
            return run(args)
        finally:
            sys.stdout.flush()
    except BrokenPipeError:
        # who read our output has gone, as `head` does; what is still held back goes nowhere
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError):
                stream.flush()
                continue
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
        return BROKEN_PIPE


def run(args: list[str]) -> int:
    """Find the subcommand and turn what goes wrong into a sentence and an exit code."""
    if not args or args[0] in ("-h", "--help", "help"):
        print(usage())
        return 0 if args else 2
    if args[0] == "--version":
        from semsfm_colmap import __version__

        print(f"semsfm {__version__}")
        return 0
    command = find_command(args[0])
    if command is None:
        import difflib

        near = difflib.get_close_matches(args[0], [known.name for known in COMMANDS], n=1)
        hint = f"; did you mean {near[0]}?" if near else ""
        tell(f"semsfm: unknown command {args[0]}{hint} (semsfm --help lists them)")
        return 2
    from semsfm_colmap.errors import SemSfmError
    from semsfm_colmap.io.disk import full_disk_error, out_of_space
    from semsfm_colmap.io.interrupt import Terminated, handle_termination

    handle_termination()
    try:
        command.main()(args[1:])
    except SemSfmError as error:
        tell(f"semsfm {args[0]}: {error}")
        return error.exit_code
    except KeyboardInterrupt as stop:
        tell(f"semsfm {args[0]}: stopped; what was finished is kept, the same command goes on")
        return TERMINATED if isinstance(stop, Terminated) else INTERRUPTED
    except BrokenPipeError:
        raise
    except ImportError as error:
        tell(f"semsfm {args[0]}: {does_not_load(error)}")
        return 1
    except OSError as error:
        if ".so" in str(error) and error.errno is None:  # a shared object, by ctypes
            tell(f"semsfm {args[0]}: {does_not_load(error)}")
            return 1
        if out_of_space(error):
            full = full_disk_error(Path(error.filename or "."))
            tell(f"semsfm {args[0]}: {full}")
            return 2
        place = f"{error.filename}: " if error.filename else ""
        tell(f"semsfm {args[0]}: {place}{error.strerror or error}")
        return 2
    return 0


def does_not_load(error: Exception) -> str:
    """A sentence for a library that is missing, or that misses a part of the system."""
    reason = str(error).splitlines()[0].rstrip(".") if str(error) else type(error).__name__
    return f"a library does not load ({reason}): `semsfm doctor` says what to install"


if __name__ == "__main__":
    sys.exit(main())
