from __future__ import annotations

import subprocess
import sys

import pytest

from semsfm_colmap.cli.main import main
from semsfm_colmap.errors import UsageError
from semsfm_colmap.exports.registry import FORMATS, find_format


def test_an_unknown_format_is_answered_with_the_nearest() -> None:
    with pytest.raises(UsageError, match="did you mean openmvs"):
        find_format("openmsv")


def test_the_command_line_knows_every_format(capsys) -> None:
    with pytest.raises(SystemExit):
        main(["export", "--help"])
    said = " ".join(capsys.readouterr().out.replace("│", " ").split())
    for name, entry in FORMATS.items():
        assert f"{name}: {entry.description}" in said
    with pytest.raises(SystemExit) as stop:
        main(["export", "p", "--to", "openmsv"])
    assert stop.value.code == 2


def test_asking_for_the_names_loads_nothing_heavy() -> None:
    code = (
        "import sys, semsfm_colmap.exports.registry;"
        "print([n for n in ('numpy', 'scipy', 'pycolmap', 'cv2') if n in sys.modules])"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "[]"
