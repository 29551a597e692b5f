"""What an installation weighs: the core, and the extras on top of it.

The wheel is built and installed into a fresh virtual environment with the versions of
constraints.txt, then each extra; every time the number of packages, the disk that the environment
takes and what `pip check` says.
Megabytes (10^6 bytes) are those that the file system gives to the whole environment, pip and
compiled Python (`__pycache__`) included. Below it the packages that weigh most in the core, as
they list their own files.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from benchmarks import tables

COMMAND = "install"
ROOT = Path(__file__).parents[1]
CHOICES = ("", "[mesh]", "[all]")
"""Each has what the ones before it have."""
MEGABYTE = 1e6
NUM_HEAVIEST = 10
OF_DISTRIBUTIONS = """
import json
from importlib.metadata import distributions
print(json.dumps({
    d.name: sum(p.stat().st_size for f in d.files or () if (p := f.locate()).is_file())
    for d in distributions()
}))
"""
"""Sizes in bytes by distribution, printed by the Python of an environment."""


@dataclass(frozen=True, kw_only=True)
class Environment:
    """A virtual environment with the wheel."""

    choice: str
    sizes: dict[str, int]
    """bytes of each distribution"""
    total: int
    """bytes on the disk"""
    compiled: int
    """of which are compiled Python"""
    sound: str
    """what `pip check` says"""


def on_disk(files: Iterable[Path]) -> int:
    """Bytes that the file system gives to files, links as such."""
    return sum(512 * path.lstat().st_blocks for path in files)


def run(*words: object, cwd: Path | None = None) -> str:
    """A command's output; an error when it fails."""
    command = [str(word) for word in words]
    return subprocess.run(command, check=True, capture_output=True, text=True, cwd=cwd).stdout


def build_wheel(folder: Path) -> Path:
    """The wheel of this tree."""
    run(sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", folder, cwd=ROOT)
    (wheel,) = folder.glob("*.whl")
    return wheel


def weigh(folder: Path, choice: str) -> Environment:
    """What lies in an environment."""
    python = folder / "bin" / "python"
    files = [path for path in folder.rglob("*") if path.is_file() or path.is_symlink()]
    return Environment(
        choice=choice,
        sizes=json.loads(run(python, "-c", OF_DISTRIBUTIONS)),
        total=on_disk(files),
        compiled=on_disk(path for path in files if path.suffix == ".pyc"),
        sound=run(python, "-m", "pip", "check").strip(),
    )


def tables_of(environments: list[Environment]) -> str:
    """Both tables."""
    core = environments[0]
    heaviest = sorted(core.sizes.items(), key=lambda item: -item[1])[:NUM_HEAVIEST]
    return "\n\n".join(
        [
            tables.table(
                ("pip install", "packages", "MB", "of which compiled Python", "pip check"),
                [
                    (
                        f"`semsfm-colmap{e.choice}`",
                        len(e.sizes),
                        f"{e.total / MEGABYTE:.0f}",
                        f"{e.compiled / MEGABYTE:.0f}",
                        e.sound,
                    )
                    for e in environments
                ],
            ),
            tables.table(
                ("heaviest in the core", "MB"),
                [(name, f"{size / MEGABYTE:.0f}") for name, size in heaviest],
            ),
        ]
    )


def main() -> None:
    """Measure, print, and put the tables into a page."""
    parser = tables.parser(COMMAND, __doc__)
    tables.add_page_option(parser, COMMAND)
    given = parser.parse_args()
    environments = []
    with tempfile.TemporaryDirectory(prefix="semsfm-") as text:
        folder = Path(text)
        wheel = build_wheel(folder / "dist")
        venv = folder / "venv"
        run(sys.executable, "-m", "venv", venv)
        pip = (venv / "bin" / "python", "-m", "pip", "install")
        for choice in CHOICES:
            run(*pip, "--constraint", ROOT / "constraints.txt", f"{wheel}{choice}")
            environments.append(weigh(venv, choice))
            print(choice or "core", f"{environments[-1].total / MEGABYTE:.0f} MB")
    said = tables_of(environments)
    print(said)
    if given.markdown is not None:
        tables.put(given.markdown, COMMAND, said)


if __name__ == "__main__":
    main()
