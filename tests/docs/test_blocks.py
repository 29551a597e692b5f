"""Every command and code block of the README and of docs/ is what the program understands.

A block says what it is: ``sh`` are commands of ours, parsed by the real command line; ``sh
title="other programs"`` those of others; ``python`` is executed, ``toml title="..."`` is read by
what reads that file; ``text`` is no code. `test_pages_run.py` runs those of the pages for users.
"""

from __future__ import annotations

import contextlib
import importlib
import io
import re
import shutil
import subprocess
from pathlib import Path

import pytest
import tyro

from semsfm_colmap.cli.commands import find_command
from semsfm_colmap.cli.common import SHORT_FLAGS
from tests.docs.blocks import ALL, OTHERS, PAGES, ROOT, commands_of, of, prose_of
from tests.docs.commands import FORMS, flags_of

OTHER_PROGRAMS = {
    "apptainer",
    "bash",
    "docker",
    "mkdir",
    "rattler-build",
    "colmap",
    "dask",
    "eval",
    "DensifyPointCloud",
    "InterfaceCOLMAP",
    "ReconstructMesh",
    "pip",
    "python3",
    "TextureMesh",
    "newstack",
    "ns-train",
    "tilt",
}

OTHER_FLAGS = {"--ImageReader.mask_path", "--help", "--no_", "--user"}
"""Flags in the words of a page that are another program's, or none by themselves."""


class Parsed(Exception):  # noqa: N818
    """A command line was understood; what it would do is not done."""


def parse(words: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Parse a command of semsfm as the program does, and stop there."""
    command = find_command(words[1])
    assert command is not None, f"there is no command {words[1]}"
    understood = tyro.cli

    def stop(*arguments: object, **keywords: object) -> None:
        understood(*arguments, **keywords)  # type: ignore[call-overload]
        raise Parsed

    said = io.StringIO()
    with monkeypatch.context() as patch, contextlib.redirect_stderr(said):
        patch.setattr(tyro, "cli", stop)
        try:
            with contextlib.redirect_stdout(said):
                command.main()(words[2:])
        except Parsed:
            return
        except SystemExit as end:
            refused = end.code != 0
        else:
            refused = True
    if refused:
        pytest.fail(f"{' '.join(words)}: {said.getvalue() or 'tyro.cli was not asked'}")


OURS = [block for block in of("sh") if block.title != OTHERS]


def test_there_are_blocks_of_every_kind_on_every_kind_of_page():
    assert len(OURS) > 30
    assert len(of("python")) >= 6
    assert {block.page.split("/")[1] for block in OURS if "/" in block.page} >= {
        "tutorial",
        "how-to",
    }


def test_every_block_says_what_it_is():
    known = {"sh", "python", "toml", "text"}
    assert [str(block) for block in ALL if block.language not in known] == []


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_no_command_hides_in_an_indented_block(path):
    assert re.findall(r"^    (?:semsfm|colmap|python|bash) .*$", prose_of(path), re.M) == []


@pytest.mark.parametrize("block", OURS, ids=str)
def test_our_commands_are_understood(block, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "options.toml").write_text("seed = 1\n")
    commands = list(commands_of(block.text))
    assert commands
    for words in commands:
        program, *arguments = words
        if Path(program).name == "semsfm" and arguments[0] == "--version":
            continue
        if program == "semsfm":
            parse(words, monkeypatch)
        elif program == "python" and arguments[0] == "-m":
            assert importlib.util.find_spec(arguments[1]) is not None, words
        elif program in ("python", "bash"):
            assert (ROOT / arguments[0]).is_file(), words
        else:
            # what setting up brings: .venv/bin/pytest, .venv/bin/pip
            assert program.startswith(".venv/bin/"), f"{block}: {program}: is it another program's?"


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_commands_within_the_words_have_flags_that_there_are(path, flags):
    for span in re.findall(r"`(semsfm [^`]*)`", prose_of(path)):
        words = re.sub(r"[\[\]]", "", " ".join(span.split())).split()
        if words[1] == "COMMAND" or words[1].startswith("--"):
            continue
        assert words[1] in flags, span
        for word in words[2:]:
            if word.startswith("--") and not word.startswith("--help"):
                assert word.split("=")[0] in flags[words[1]], f"{path.name}: {span}"


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_flags_by_themselves_are_those_of_a_command(path, flags):
    ours = "".join(p.read_text("utf-8") for p in ROOT.glob("benchmarks/**/*.py"))
    known = set().union(*flags.values(), re.findall(r'"(--\w+)"', ours), OTHER_FLAGS)
    spans = re.findall(r"`(--[a-zA-Z][\w.]*)", prose_of(path))
    assert [flag for flag in spans if flag.rstrip(".") not in known and flag[-1] != "."] == []


@pytest.fixture(scope="module")
def flags() -> dict[str, set[str]]:
    """The flags of each command, in each of its forms."""
    found: dict[str, set[str]] = {}
    for command, form in FORMS:
        found.setdefault(command.name, set()).update(flags_of(command, form), SHORT_FLAGS)
    return found


@pytest.mark.parametrize("block", of("sh", OTHERS), ids=str)
def test_other_programs_are_named_as_such(block):
    text = re.sub(r"^(#SBATCH|series=).*$", "", block.text, flags=re.M)
    for words in commands_of(text):
        if words[0] == "semsfm":  # within a script of a scheduler
            assert find_command(words[1]) is not None
            continue
        assert words[0] in OTHER_PROGRAMS, f"{block}: {words[0]}"


@pytest.mark.skipif(shutil.which("colmap") is None, reason="COLMAP is not installed")
@pytest.mark.parametrize("block", of("sh", OTHERS), ids=str)
def test_colmap_has_the_flags_that_are_named(block):
    for program, *words in commands_of(block.text):
        if program == "colmap" and words[0] != "gui":
            done = subprocess.run(["colmap", words[0], "-h"], capture_output=True, text=True)
            for word in words[1:]:
                if word.startswith("--"):
                    assert f"{word} " in done.stdout + done.stderr, f"{block}: {words[0]} {word}"


@pytest.mark.parametrize("block", of("toml"), ids=str)
def test_files_are_read_by_what_reads_them(block, tmp_path):
    from semsfm_colmap.config import read_config
    from semsfm_colmap.metrology.sizes.request_file import parse_requests
    from semsfm_colmap.segmentation.cut_file import read_cuts

    readers = {
        "options.toml": read_config,
        "PROJECT/segments.toml": read_cuts,
        "PROJECT/measurements.toml": lambda path: parse_requests(
            path.read_text("utf-8"), path.name
        ),
    }
    path = tmp_path / Path(block.title).name
    path.write_text(block.text, encoding="utf-8")
    assert readers[block.title](path)


def test_a_table_of_the_tutorial_is_a_table_of_a_series(tmp_path):
    from semsfm_colmap.ingest.series.table import read_series_table

    (block,) = of("text", "series.csv")
    path = tmp_path / "series.csv"
    path.write_text(block.text, encoding="utf-8")
    assert [row.tilt_deg for row in read_series_table(path).rows] == [0.0, 5.0, 10.0]


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_modules_and_names_of_the_package_that_a_page_names_are_there(path):
    text = prose_of(path)
    for name in re.findall(r"`semsfm_colmap\.([\w.]+?)(?:\([^`]*\))?`", text):
        found: object = importlib.import_module("semsfm_colmap")
        for part in name.split("."):
            try:
                found = getattr(found, part)
            except AttributeError:
                found = importlib.import_module(f"{found.__name__}.{part}")  # type: ignore[attr-defined]
    for name in re.findall(r"`((?:\w+/)+\w+\.(?:py|sh))", text):
        places = [ROOT / name, ROOT / "semsfm_colmap" / name, *ROOT.glob(f"semsfm_colmap/*/{name}")]
        assert any(place.is_file() for place in places), f"{path.name}: {name}"
