"""Every table has a command that explains itself, and the pages of docs/ name these commands."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks import tables

ROOT = Path(__file__).parents[2]
COMMANDS = sorted(
    path.parent.name if path.name == "__main__.py" else path.stem
    for path in [*ROOT.glob("benchmarks/*.py"), *ROOT.glob("benchmarks/*/__main__.py")]
    if path.stem not in ("__init__", "tables")
)


@pytest.mark.parametrize("command", COMMANDS)
def test_every_benchmark_explains_itself(command):
    done = subprocess.run(
        [sys.executable, "-m", f"benchmarks.{command}", "--help"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    assert f"usage: python -m benchmarks.{command}" in done.stdout
    assert done.stderr == ""


@pytest.mark.parametrize("page", sorted(ROOT.glob("docs/**/*.md")), ids=lambda p: p.name)
def test_the_tables_of_a_page_can_be_replaced_by_the_commands_that_it_names(page):
    text = page.read_text(encoding="utf-8")
    named = re.findall(r"^<!-- tables: python -m benchmarks\.(.*) -->$", text, flags=re.M)
    for command in named:
        assert command.split()[0] in COMMANDS
        tables.replaced(text, command, "")
    assert text.count(tables.END) == len(named)
