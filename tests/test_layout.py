"""Where heavy libraries are imported."""

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import semsfm_colmap

PACKAGE = Path(semsfm_colmap.__file__).parent


def imported(path: Path) -> Iterator[str]:
    """Top-level names of what a module imports, at its top and inside its functions."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name.split(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module.split(".")[0]


def homes(library: str) -> set[str]:
    """Modules that import a library, as paths in the package."""
    return {
        path.relative_to(PACKAGE).as_posix()
        for path in PACKAGE.rglob("*.py")
        if library in imported(path)
    }


def test_numba_is_imported_by_kernel_modules_alone():
    # how many threads the kernels take is asked of numba as well
    elsewhere = {name for name in homes("numba") if not name.endswith("_kernels.py")}
    assert elsewhere == {"geometry/threads.py"}


def test_open3d_is_asked_for_through_one_module_alone():
    assert homes("open3d") == set()
    users = [
        path.relative_to(PACKAGE).as_posix()
        for path in PACKAGE.rglob("*.py")
        if re.search(r"""import_(module|extra)\(\s*['"]open3d""", path.read_text())
    ]
    assert users == ["io/open3d_library.py"]


def test_kernel_modules_hold_typed_kernels():
    for path in PACKAGE.rglob("*_kernels.py"):
        text = path.read_text()
        assert "numba.njit(" in text, path
        assert "no-untyped-def" not in text, path


@pytest.mark.parametrize("library", ["numba", "open3d", "matplotlib", "scipy"])
def test_help_of_no_command_loads_what_takes_long(library):
    code = f"""
import contextlib, io, sys
from semsfm_colmap.cli.main import COMMANDS, main
for command in COMMANDS:
    with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit):
        main([command.name, "--help"])
    assert {library!r} not in sys.modules, command.name
"""
    subprocess.run([sys.executable, "-c", code], check=True)
