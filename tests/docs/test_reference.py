"""The reference pages say what the command line and the configuration have."""

from __future__ import annotations

import importlib.util
import re
import sys
from dataclasses import fields, is_dataclass
from pathlib import Path
from types import ModuleType

import pytest

import semsfm_colmap
from semsfm_colmap.cli.commands import COMMANDS
from semsfm_colmap.cli.common import SHORT_FLAGS
from semsfm_colmap.config import Config
from tests.docs.blocks import ROOT
from tests.docs.commands import FORMS, flags_of


@pytest.fixture(scope="module")
def reference() -> ModuleType:
    path = ROOT / "scripts/reference.py"
    spec = importlib.util.spec_from_file_location("reference", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["reference"] = module  # its dataclasses look their module up
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def pages(reference: ModuleType) -> dict[str, str]:
    made: dict[str, str] = reference.pages()
    return made


@pytest.mark.parametrize(("command", "form"), FORMS, ids=lambda value: getattr(value, "name", ""))
def test_a_command_has_the_flags_of_its_help(command, form, reference):
    kind, _ = reference.arguments_of(command, form)
    listed, left = set(), list(reference.options_of(kind))
    while left:
        option = left.pop()
        if isinstance(option, reference.Section):
            # it has a page of its own
            left.extend(reference.options_of(option.kind, option.kind(), option.prefix))
            continue
        if not option.positional:
            listed.add(f"--{option.name}")
        assert option.words, f"semsfm {command.name}: {option.name} is not explained"
    switched = {flag for flag in flags_of(command, form) if re.search(r"--(\w+\.)*no_", flag)}
    flags = flags_of(command, form) - switched
    # the help names other spellings of a flag beside it
    assert flags - listed - {"--format", *SHORT_FLAGS} == set()
    assert listed - flags == set()


def test_every_command_and_every_option_has_its_place(pages):
    commands, options = pages["reference/commands.md"], pages["reference/options.md"]
    for command in COMMANDS:
        assert f"## semsfm {command.name}\n" in commands
    for section in fields(Config):
        value = getattr(Config(), section.name)
        keys = [f.name for f in fields(value)] if is_dataclass(value) else [section.name]
        for key in keys:
            row = re.search(rf"^\| `{key}` \| .* \| .* \| (\S.*) \|$", options, re.M)
            assert row is not None, f"{section.name}.{key}"


def test_the_default_of_an_option_is_that_of_the_configuration(pages):
    line = f"| `max_error_px` | number | `{Config().matching.max_error_px}` |"
    assert line in pages["reference/options.md"]


def test_the_python_page_has_every_public_name(pages):
    page = pages["reference/python.md"]
    for name in semsfm_colmap.__all__:
        assert (f"::: semsfm_colmap.{name}\n" in page) == (name != "__version__")


def test_every_page_of_the_site_is_a_file_or_made_by_it(pages):
    text = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    named = set(re.findall(r"[\w/-]+\.md", text[text.index("\nnav:") :]))
    made = set(pages) | {
        f"development/{n}.md" for n in ("architecture", "contributing", "changelog")
    }
    there = {
        path.relative_to(ROOT / "docs").as_posix() for path in Path(ROOT / "docs").rglob("*.md")
    }
    assert named == made | there
