"""`semsfm view PROJECT`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from semsfm_colmap.cli.common import parse
from semsfm_colmap.io.terminal import tell
from semsfm_colmap.metrology.sizes.options import MetrologyOptions

DESCRIPTION = """Show a project in the browser: model, surface, cameras; sections; lengths and
angles of the surface with their budgets (docs/report.md). The server answers this machine alone and
writes nothing; while `semsfm reconstruct` runs, the page shows what is there. Ctrl-C ends it."""


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """Arguments of the command."""

    project_path: tyro.conf.Positional[Path]
    """The project folder."""
    browser: bool = True
    """Open a browser at the address; without, it is only printed."""
    options: Annotated[MetrologyOptions, tyro.conf.arg(name="")] = field(
        default_factory=MetrologyOptions
    )


def main(arguments: Sequence[str]) -> None:
    """Run the command."""
    from semsfm_colmap.pipeline.view import view

    parsed = parse(Arguments, arguments, "view", DESCRIPTION)

    def say(line: str) -> None:
        tell(line)

    view(
        parsed.project_path,
        options=parsed.options,
        open_browser=parsed.browser,
        say=say,
    )
