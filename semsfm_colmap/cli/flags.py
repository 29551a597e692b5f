"""The flags that follow from a command's dataclass: name, values, default, words, section.

tyro makes the parser and the full help; this is the same list as data, for the short help and for
shell completion. A test holds the two together for every command.
"""

from __future__ import annotations

import ast
import inspect
import textwrap
import types
from collections.abc import Iterator
from dataclasses import MISSING, Field, dataclass, fields, is_dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import tyro

from semsfm_colmap.bounds import bounds_of

POSITIONAL = get_args(tyro.conf.Positional[int])[1]
NO_PREFIX = get_args(tyro.conf.OmitArgPrefixes[int])[1]


MAX_CHOICES = 60
"""Longer lists of values do not stand beside the flag."""


@dataclass(frozen=True, kw_only=True)
class Flag:
    """One flag, or a positional argument."""

    name: str
    """as it is typed: --matching.overlap; of a positional argument a word in capitals"""
    help: str
    section: str = ""
    """matching, ...; empty for those without a prefix"""
    values: str = ""
    """what follows it, as a person says it; empty for a switch"""
    choices: tuple[str, ...] = ()
    default: str = ""
    """empty where there is none"""
    required: bool = False
    is_path: bool = False
    short: str = ""

    @property
    def is_positional(self) -> bool:
        """True for an argument without a flag."""
        return not self.name.startswith("-")

    @property
    def is_switch(self) -> bool:
        """True for a flag without a value; it has a twin that begins with no_."""
        return not self.values and not self.is_positional


@dataclass(frozen=True, kw_only=True)
class Section:
    """A group of flags with the same prefix."""

    name: str
    help: str
    num_flags: int


def last(flag: Flag) -> str:
    """The name of a flag without its section."""
    return flag.name.removeprefix("--").rsplit(".", 1)[-1]


def negated(flag: Flag) -> str:
    """How a switch is switched off: --guided.no_enabled."""
    return f"{flag.name.removesuffix(last(flag))}no_{last(flag)}"


def words_of(kind: type) -> dict[str, str]:
    """The docstrings that stand below the fields of a dataclass and of its bases."""
    found: dict[str, str] = {}
    for parent in reversed(kind.__mro__):
        if not is_dataclass(parent):
            continue
        try:
            tree = ast.parse(textwrap.dedent(inspect.getsource(parent)))
        except (OSError, SyntaxError, TypeError):
            continue  # made at run time, without words of its own
        body = tree.body[0].body if isinstance(tree.body[0], ast.ClassDef) else []
        for statement, after in pairwise(body):
            if isinstance(statement, ast.AnnAssign) and isinstance(statement.target, ast.Name):
                text = after.value if isinstance(after, ast.Expr) else None
                if isinstance(text, ast.Constant) and isinstance(text.value, str):
                    found[statement.target.id] = " ".join(text.value.split())
    return found


def flags_of(command: type, section: str = "", given: Any = None) -> Iterator[Flag]:
    """The flags of a command in their order.

    Parameters
    ----------
    section : what stands before each name, with its point
    given : an instance that has the defaults; None: those of the fields

    """
    hints = get_type_hints(command, include_extras=True)
    words = words_of(command)
    for one in fields(command):
        hint: Any = hints[one.name]
        settings: tuple[Any, ...] = ()
        if get_origin(hint) is Annotated:
            hint, *rest = get_args(hint)
            settings = tuple(rest)
        default = _default(one) if given is None else getattr(given, one.name)
        if is_dataclass(hint):
            bare = NO_PREFIX in settings or any(getattr(s, "name", None) == "" for s in settings)
            inner = None if default is MISSING else default
            nested: Any = hint
            yield from flags_of(nested, section if bare else f"{section}{one.name}.", inner)
        else:
            yield _flag(one.name, hint, settings, words.get(one.name, ""), section, default)


def _default(one: Field[Any]) -> Any:
    return one.default if one.default_factory is MISSING else one.default_factory()


def _flag(
    name: str, kind: Any, settings: tuple[Any, ...], words: str, section: str, default: Any
) -> Flag:
    bounds = bounds_of(Annotated[kind, *settings] if settings else kind)
    aliases, said, kind = (), "", _kind(kind)
    for setting in settings:  # of tyro.conf.arg
        aliases = getattr(setting, "aliases", None) or aliases
        said = getattr(setting, "help", None) or said
        make = getattr(setting, "constructor_factory", None)
        made = None if make is None else make()
        kind = made if get_origin(made) is Literal else kind
    return Flag(
        name=_capitals(name) if POSITIONAL in settings else f"--{section}{name}",
        help=(said or words) + (f" A number {bounds}." if bounds else ""),
        section=section.rstrip("."),
        values="" if kind is bool else _values(kind),
        choices=tuple(str(c) for c in get_args(kind)) if get_origin(kind) is Literal else (),
        default="" if default is MISSING else _text(default),
        required=default is MISSING,
        is_path=kind is Path or Path in get_args(kind),
        short=aliases[0] if aliases else "",
    )


def _capitals(name: str) -> str:
    """``image_path`` is given as IMAGES, another path as what it leads to."""
    plural = {"image_path": "IMAGES", "project_paths": "PROJECT..."}
    return plural.get(name, name.removesuffix("_path").upper())


def _kind(hint: Any) -> Any:
    """The type of a value that may also be absent."""
    if get_origin(hint) in (Union, types.UnionType):
        (kind, *_) = (_kind(part) for part in get_args(hint) if part is not type(None))
        return Literal["True", "False", "None"] if kind is bool else kind
    return get_args(hint)[0] if get_origin(hint) is Annotated else hint


def _values(kind: Any) -> str:
    kind = _kind(kind)
    if get_origin(kind) is Literal:
        text = "{" + ",".join(str(choice) for choice in get_args(kind)) + "}"
        return text if len(text) <= MAX_CHOICES else "NAME"
    if get_origin(kind) is tuple:
        parts = get_args(kind)
        if parts[-1] is Ellipsis:
            return f"{_values(parts[0])} ..."
        return " ".join(_values(part) for part in parts)
    return {Path: "PATH", float: "NUMBER", int: "INTEGER", str: "TEXT"}.get(kind, "VALUE")


def _text(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, tuple):
        return " ".join(_text(part) for part in value)
    return str(value)


def sections_of(command: type, flags: list[Flag]) -> list[Section]:
    """The sections among some flags of a command, with their words."""
    words: dict[str, str] = {}

    def gather(kind: Any) -> None:
        hints = get_type_hints(kind)
        for one in fields(kind):
            inner = hints[one.name]
            if is_dataclass(inner):
                words.setdefault(one.name, words_of(kind).get(one.name) or _first_line(inner))
                gather(inner)

    gather(command)
    names = dict.fromkeys(flag.section for flag in flags if flag.section)
    return [
        Section(
            name=name,
            help=words.get(name.rsplit(".", 1)[-1], ""),
            num_flags=sum(flag.section == name for flag in flags),
        )
        for name in names
    ]


def _first_line(kind: Any) -> str:
    return (inspect.getdoc(kind) or "").splitlines()[0].rstrip(".") if kind.__doc__ else ""
