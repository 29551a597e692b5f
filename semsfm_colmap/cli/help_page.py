"""The help of a command: the short one, of one section, or (tyro's) of everything.

semsfm COMMAND --help            examples and the options used first
semsfm COMMAND --help SECTION    the options of a section, e.g. matching
semsfm COMMAND --help-all        every option
"""

from __future__ import annotations

import difflib
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from shutil import get_terminal_size

from semsfm_colmap.cli.flags import Flag, flags_of, negated, sections_of
from semsfm_colmap.cli.help_texts import EXAMPLES, FIRST
from semsfm_colmap.errors import UsageError

ALL = ("--help-all", "--help_all")
HELP = ("-h", "--help")
MAX_WIDTH = 100
COLUMN = 30
"""Where the words beside a flag begin."""


def asked(arguments: Sequence[str]) -> str | None:
    """What help is asked for: "" for the short one, a section's name, or ``--help-all``."""
    for k, argument in enumerate(arguments):
        if argument in ALL:
            return ALL[0]
        if argument.startswith("--help="):
            return argument.split("=", 1)[1]
        if argument in HELP:
            after = arguments[k + 1] if k + 1 < len(arguments) else ""
            return ALL[0] if after in ALL else "" if after.startswith("-") else after
    return None


def help_alone(arguments: Sequence[str]) -> list[str]:
    """The arguments, or the help that they ask for and nothing else."""
    wanted = asked(arguments)
    if wanted is None:
        return list(arguments)
    return [wanted] if wanted == ALL[0] else [f"--help={wanted}"]


def page(command: type, name: str, description: str, section: str = "") -> str:
    """The help of a command, or of one of its sections."""
    flags = list(flags_of(command))
    width = min(get_terminal_size((80, 24)).columns, MAX_WIDTH)
    if section:
        return "\n".join(_section(command, flags, name, section, width))
    return "\n".join(_short(command, flags, name, description, width))


def _short(
    command: type, flags: list[Flag], name: str, description: str, width: int
) -> Iterator[str]:
    positional = [flag for flag in flags if flag.is_positional]
    needed = [f"{flag.name} {flag.values}" for flag in flags if flag.required and flag.values]
    needed = [text for text in needed if text.startswith("-")]
    yield " ".join(
        ["usage: semsfm", name, *(flag.name for flag in positional), *needed, "[options]"]
    )
    yield ""
    for paragraph in description.split("\n\n"):
        plain = paragraph.startswith(" ")
        yield from [paragraph] if plain else textwrap.wrap(paragraph, width)
        yield ""
    if name in EXAMPLES:
        yield "examples:"
        yield from _examples(name, width)
        yield ""
    if positional:
        yield "arguments:"
        yield from _listed(positional, width)
        yield ""
    options = [flag for flag in flags if not flag.is_positional]
    first = first_of(name, options)
    yield "options:" if len(first) == len(options) else "options used first:"
    yield from _listed(first, width, brief=len(first) < len(options))
    if len(first) < len(options):
        yield ""
        yield f"all {len(options)} options: semsfm {name} --help-all"
        sections = sections_of(command, options)
        if sections:
            yield f"those of a section: semsfm {name} --help SECTION"
        for one in sections:
            words = textwrap.shorten(one.help, width - 24, placeholder=" ...")
            yield f"  {one.name:<16}{words} ({one.num_flags})"


def first_of(name: str, options: Sequence[Flag]) -> list[Flag]:
    """The options that the short help shows."""
    if name not in FIRST:
        return [flag for flag in options if not flag.section]
    by_name = {flag.name: flag for flag in options}
    needed = [flag.name for flag in options if flag.required]
    shown = dict.fromkeys([*needed, *FIRST[name]])
    return [by_name[flag] for flag in shown if flag in by_name]


def _section(
    command: type, flags: list[Flag], name: str, section: str, width: int
) -> Iterator[str]:
    sections = {one.name: one for one in sections_of(command, flags)}
    if section not in sections:
        near = difflib.get_close_matches(section, sections, n=1)
        hint = f"; did you mean {near[0]}?" if near else ""
        known = ", ".join(sections) or "none"
        raise UsageError(f"--help {section}: the sections of this command are {known}{hint}")
    yield f"semsfm {name}: {sections[section].help}"
    yield ""
    yield from _listed([flag for flag in flags if flag.section == section], width)


def _examples(name: str, width: int) -> Iterator[str]:
    for text, purpose in EXAMPLES[name]:
        line = text if text.startswith("eval") else f"semsfm {text}"
        if len(line) + len(purpose) + 6 <= width:
            yield f"  {line}" + (f"    {purpose}" if purpose else "")
        else:
            yield f"  {line}"
            yield f"      {purpose}"


def _listed(flags: Iterable[Flag], width: int, *, brief: bool = False) -> Iterator[str]:
    """Flags with their words beside them, or with the first sentence of these."""
    for flag in flags:
        head = f"  {flag.short + ', ' if flag.short else ''}{flag.name}"
        if flag.values and not flag.is_positional:
            head += f" {flag.values}"
        words = flag.help.split(". ")[0].rstrip(".") + "." if brief else flag.help
        if flag.required and not flag.is_positional:
            words += " Needed."
        elif flag.default and not (flag.is_switch and flag.default == "no"):
            words += f" [{flag.default}]"
        if flag.is_switch and flag.default == "yes":
            words += f" Off: {negated(flag)}"
        lines = textwrap.wrap(words, width - COLUMN, break_on_hyphens=False) or [""]
        if len(head) + 2 > COLUMN:
            yield head
        else:
            yield f"{head:<{COLUMN}}{lines.pop(0)}"
        yield from (f"{'':<{COLUMN}}{line}" for line in lines)
