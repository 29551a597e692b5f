"""`semsfm doctor`: whether this installation is complete."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from semsfm_colmap.cli.common import parse
from semsfm_colmap.errors import InputError

DESCRIPTION = """Versions of Python and the libraries, whether they load, system packages that are
missing, memory, threads and disk. Ends with exit code 0 where nothing is missing, else 1."""


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """Arguments of the command."""

    path: Path = Path()
    """Folder in which projects will lie."""
    json: bool = False
    """Print an object in place of lines."""


def main(arguments: Sequence[str]) -> None:
    """Run the command."""
    from semsfm_colmap.pipeline.doctor import examine, lines_of, system_packages

    parsed = parse(Arguments, list(arguments), "doctor", DESCRIPTION)
    found = examine(parsed.path)
    if parsed.json:
        print(json.dumps(found.as_json(), indent=2))
    else:
        print("\n".join(lines_of(found.findings)))
    if found.is_content:
        return
    packages = system_packages(found.findings)
    together = f"; all system packages: apt-get install {' '.join(packages)}" if packages else ""
    count = sum(finding.state == "bad" for finding in found.findings)
    raise InputError(f"{count} of {len(found.findings)} are not as they should be{together}")
