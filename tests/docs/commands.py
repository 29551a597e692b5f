"""What the command line takes, asked of tyro itself: arguments of a command, and their flags."""

from __future__ import annotations

import contextlib
import io
import re
from typing import Any

import pytest
import tyro

from semsfm_colmap.cli.commands import COMMANDS, Command

FORMS = [
    *((command, ()) for command in COMMANDS),
    *((command, ("--database_path",)) for command in COMMANDS if command.name == "map"),
    *((command, ("--colmap_path",)) for command in COMMANDS if command.name == "mesh"),
]
"""Commands, and the flag that some of them take other arguments after."""


class Caught(Exception):  # noqa: N818
    """What a command was about to parse into."""


def arguments_of(command: Command, form: tuple[str, ...]) -> Any:
    """The dataclass that a command parses its arguments into."""

    def catch(kind: Any, **_: Any) -> None:
        raise Caught(kind)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tyro, "cli", catch)
        with pytest.raises(Caught) as caught:
            command.main()(list(form))
    return caught.value.args[0]


def flags_of(command: Command, form: tuple[str, ...]) -> set[str]:
    """Its flags as tyro lists them in its help, those that switch off included."""
    said = io.StringIO()
    kind = arguments_of(command, form)
    with contextlib.redirect_stdout(said), contextlib.suppress(SystemExit):
        tyro.cli(kind, args=["--help"], use_underscores=True)
    lines = re.findall(r"^[│ ]*(-\S.*)$", said.getvalue(), re.M)
    found = {flag for line in lines for flag in re.findall(r"--[a-z0-9][\w.]*", line)}
    return {flag.rstrip(".") for flag in found} - {"--help"}
