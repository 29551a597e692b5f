"""`semsfm completion`: what the shell needs to complete commands, options and their values."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import tyro

from semsfm_colmap.cli.commands import COMMANDS, Command
from semsfm_colmap.cli.common import SHORT_FLAGS, described, parse
from semsfm_colmap.cli.flags import Flag, flags_of, negated
from semsfm_colmap.cli.help_page import ALL

DESCRIPTION = """A script for bash, zsh or fish that completes commands, options, their values and
files. The options are those of this version: make it anew after an update."""
GENERAL = ("--help", ALL[0])
"""Options of every command."""


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """Arguments of the command."""

    shell: tyro.conf.Positional[Literal["bash", "zsh", "fish"]]
    """The shell. bash, zsh: eval "$(semsfm completion bash)" in the start file; fish: a file in
    ~/.config/fish/completions."""


def main(arguments: Sequence[str]) -> None:
    """Run the command."""
    parsed = parse(Arguments, list(arguments), "completion", DESCRIPTION)
    print(SCRIPTS[parsed.shell](flags_of_commands()))


def flags_of_commands(commands: Iterable[Command] = COMMANDS) -> dict[str, list[Flag]]:
    """For each command its flags."""
    return {command.name: list(flags_of(described(command.main()))) for command in commands}


def spellings(flags: Iterable[Flag]) -> list[str]:
    """Everything that begins with a minus, as it may be typed."""
    names: list[str] = []
    for flag in flags:
        if flag.is_positional:
            continue
        names += [flag.name, *([flag.short] if flag.short else [])]
        names += [negated(flag)] if flag.is_switch else []
    short = [key for key, full in SHORT_FLAGS.items() if full in names]
    return [*dict.fromkeys([*names, *short, *GENERAL])]


def choices_of(flags: Iterable[Flag]) -> list[tuple[str, tuple[str, ...]]]:
    """Flags with a few possible values, and these."""
    found = {flag.name: flag.choices for flag in flags if flag.choices and not flag.is_positional}
    found |= {key: found[full] for key, full in SHORT_FLAGS.items() if full in found}
    return list(found.items())


def words_first(flags: Iterable[Flag]) -> str:
    """The values of a positional argument that has only some."""
    return " ".join(choice for flag in flags if flag.is_positional for choice in flag.choices)


def bash(commands: Mapping[str, Sequence[Flag]]) -> str:
    """A function for bash's `complete`; zsh runs the same through bashcompinit."""
    options, values = [], []
    for name, flags in commands.items():
        options.append(f"        {name}) words='{' '.join(spellings(flags))}' ;;")
        values += [
            f"        {name}:{flag}) words='{' '.join(choices)}' ;;"
            for flag, choices in choices_of(flags)
        ]
        if words_first(flags):
            values.append(f"        {name}:{name}) words='{words_first(flags)}' ;;")
    names = " ".join([*commands, "--help", "--version"])
    return f"""# completion of semsfm: eval "$(semsfm completion bash)"
_semsfm() {{
    local word="${{COMP_WORDS[COMP_CWORD]}}" before="${{COMP_WORDS[COMP_CWORD-1]}}"
    local command="${{COMP_WORDS[1]}}" words=''
    COMPREPLY=()
    if [ "$COMP_CWORD" -eq 1 ]; then
        COMPREPLY=($(compgen -W '{names}' -- "$word"))
        return
    fi
    case "$command:$before" in
{chr(10).join(values)}
    esac
    if [ -z "$words" ] && [ "${{word:0:1}}" = - ]; then
        case "$command" in
{chr(10).join(f"    {line}" for line in options)}
        esac
    fi
    if [ -n "$words" ]; then
        COMPREPLY=($(compgen -W "$words" -- "$word"))
    else
        COMPREPLY=($(compgen -f -- "$word"))
        compopt -o filenames 2>/dev/null
    fi
}}
complete -F _semsfm semsfm"""


def zsh(commands: Mapping[str, Sequence[Flag]]) -> str:
    """The function for bash, run by zsh."""
    loaded = "autoload -Uz +X compinit bashcompinit && compinit -u && bashcompinit"
    return f"{loaded}\n" + bash(commands).replace("completion bash)", "completion zsh)")


def fish(commands: Mapping[str, Sequence[Flag]]) -> str:
    """One line a command and option for fish, with the words beside it."""
    help_of = {command.name: command.help for command in COMMANDS}
    lines = [
        "# completion of semsfm: semsfm completion fish > ~/.config/fish/completions/semsfm.fish",
        "complete -c semsfm -n __fish_use_subcommand -l version -d 'say the version'",
        *(
            f"complete -c semsfm -f -n __fish_use_subcommand -a {name} "
            f"-d {_quoted(help_of.get(name, ''))}"
            for name in commands
        ),
    ]
    for name, flags in commands.items():
        of = f"complete -c semsfm -n '__fish_seen_subcommand_from {name}'"
        words = {flag.name: flag.help.split(". ")[0] for flag in flags}
        choices = dict(choices_of(flags))
        needs = {flag.name for flag in flags if flag.values}
        for spelling in spellings(flags):
            full = SHORT_FLAGS.get(spelling, spelling)
            kind = "-l" if spelling.startswith("--") else "-s"
            line = f"{of} {kind} {spelling.lstrip('-')}"
            if full in choices:
                line += f" -x -a {_quoted(' '.join(choices[full]))}"
            elif full in needs:
                line += " -r"
            lines.append(line + (f" -d {_quoted(words[full])}" if full in words else ""))
        if words_first(flags):
            lines.append(f"{of} -x -a {_quoted(words_first(flags))}")
    return "\n".join(lines)


def _quoted(text: str) -> str:
    return "'" + text.replace("\\", "\\\\").replace("'", "\\'") + "'"


SCRIPTS = {"bash": bash, "zsh": zsh, "fish": fish}
