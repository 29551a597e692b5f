"""The short help, that of a section, the full one; and the flags that all of them come from."""

import re

import pytest

from semsfm_colmap.cli.commands import COMMANDS, find_command
from semsfm_colmap.cli.common import described
from semsfm_colmap.cli.flags import flags_of, negated
from semsfm_colmap.cli.help_page import asked
from semsfm_colmap.cli.help_texts import EXAMPLES, FIRST, GROUPS
from semsfm_colmap.cli.main import main, usage

NAMES = [command.name for command in COMMANDS]
MANY = 25
"""Commands with more options than this show some of them first."""


def help_of(capsys, *arguments):
    with pytest.raises(SystemExit) as stop:
        main([*arguments])
    assert stop.value.code == 0
    return capsys.readouterr().out


def flags(name):
    return list(flags_of(described(find_command(name).main())))


@pytest.mark.parametrize("name", NAMES)
def test_the_flags_are_those_that_tyro_knows(name, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "90")  # one column of boxes
    # below the description, a line of which may begin with a flag
    page = help_of(capsys, name, "--help-all")
    text = re.split(r"^\W*options\b", page, maxsplit=1, flags=re.MULTILINE)[1]
    # a row of a box, with or without its edge, that begins with a flag: "-v, --verbose"
    rows = re.findall(r"^[│| ]{0,2}(--?[a-z].*)$", text, flags=re.MULTILINE)
    known = {flag for row in rows for flag in re.findall(r"(?<![\w-])--?[a-z][\w.]*", row)}
    ours = {"-h", "--help"}
    for flag in flags(name):
        if not flag.is_positional:
            ours |= {flag.name, *([flag.short] if flag.short else [])}
            ours |= {negated(flag)} if flag.is_switch else set()
    assert known <= ours
    # a second name may begin in the middle of a row
    assert all(f"{one} " in text for one in ours - known)
    assert len(ours - known) <= 1


@pytest.mark.parametrize("name", NAMES)
def test_every_command_has_examples_and_a_help_of_one_or_two_screens(name, capsys):
    text = help_of(capsys, name, "--help")
    assert text.startswith(f"usage: semsfm {name}")
    assert "examples:" in text
    assert len(text.splitlines()) <= 75
    assert all(len(line) <= 80 or "--" in line for line in text.splitlines())
    options = [flag for flag in flags(name) if not flag.is_positional]
    if len(options) > MANY:
        assert name in FIRST
        assert f"all {len(options)} options: semsfm {name} --help-all" in text


@pytest.mark.parametrize("name", NAMES)
def test_examples_and_first_options_are_of_flags_that_exist(name):
    known = {flag.name for flag in flags(name)} | {"--depth_sign", "--segment", "--example"}
    known |= {negated(flag) for flag in flags(name) if flag.is_switch}
    known |= {"--database_path", "--colmap_path", "--image_path", "--output_path"}
    for text, _ in EXAMPLES[name]:
        if not text.startswith("eval"):
            assert text.split()[0] == name
        assert set(re.findall(r"--[\w.]+", text)) <= known
    assert set(FIRST.get(name, ())) <= known


def test_every_command_stands_under_one_purpose():
    named = [name for _, names in GROUPS for name in names]
    assert len(named) == len(set(named))
    assert set(NAMES) <= set(named)
    text = usage()
    for purpose, names in GROUPS:
        assert not set(names) & set(NAMES) or f"{purpose}:" in text


def test_a_section_shows_its_options_alone_and_in_full(capsys):
    text = help_of(capsys, "match", "--help", "matching")
    assert "--matching.static_excess NUMBER" in text
    assert "--guided" not in text
    assert "the paper's distance filter" in text
    assert help_of(capsys, "match", "--help=matching") == text
    assert main(["match", "--help", "machting"]) == 2
    assert "did you mean matching?" in capsys.readouterr().err


def test_the_help_of_a_command_on_a_folder_of_others_is_its_own(capsys):
    text = help_of(capsys, "mesh", "--colmap_path", "--help")
    assert "usage: semsfm mesh --colmap_path PATH" in text
    assert "--sparse_path" in help_of(capsys, "mesh", "--colmap_path", "--help-all")
    assert "--database_path" in help_of(capsys, "map", "--database_path", "--help")


def test_the_defaults_that_are_shown_are_those_that_hold(capsys, tmp_path):
    assert "[8192]" in help_of(capsys, "extract", "--help")
    low = help_of(capsys, "extract", "--quality", "low", "--help")
    assert "[4096]" in low
    assert "[low]" in low


@pytest.mark.parametrize(
    ("arguments", "answer"),
    [
        ([], None),
        (["p", "--quality", "low"], None),
        (["--help"], ""),
        (["p", "-h"], ""),
        (["--help", "--quality", "low"], ""),
        (["--help", "surface"], "surface"),
        (["--help=surface"], "surface"),
        (["--help-all"], "--help-all"),
        (["--help_all"], "--help-all"),
    ],
)
def test_what_help_is_asked_for(arguments, answer):
    assert asked(arguments) == answer
