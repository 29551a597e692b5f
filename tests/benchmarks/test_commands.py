"""Every table has a command that explains itself, and the pages of docs/ name these commands."""

import importlib
import re
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
def test_every_benchmark_explains_itself(command, monkeypatch, capsys):
    is_package = (ROOT / "benchmarks" / command).is_dir()
    name = f"benchmarks.{command}" + (".__main__" if is_package else "")
    monkeypatch.setattr(sys, "argv", [command, "--help"])
    with pytest.raises(SystemExit) as end:
        importlib.import_module(name).main()
    assert end.value.code == 0
    out, err = capsys.readouterr()
    assert f"usage: python -m benchmarks.{command}" in out
    assert err == ""


def test_they_are_commands():
    # what python -m runs ends with a call of main
    for command in COMMANDS:
        folder = ROOT / "benchmarks" / command
        file = folder / "__main__.py" if folder.is_dir() else folder.with_suffix(".py")
        text = file.read_text(encoding="utf-8")
        assert re.search(r'^if __name__ == "__main__":\n    main\(\)$', text, flags=re.M), command


@pytest.mark.parametrize("page", sorted(ROOT.glob("docs/**/*.md")), ids=lambda p: p.name)
def test_the_tables_of_a_page_can_be_replaced_by_the_commands_that_it_names(page):
    text = page.read_text(encoding="utf-8")
    named = re.findall(r"^<!-- tables: python -m benchmarks\.(.*) -->$", text, flags=re.M)
    for command in named:
        assert command.split()[0] in COMMANDS
        tables.replaced(text, command, "")
    assert text.count(tables.END) == len(named)
