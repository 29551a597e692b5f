"""The reference pages of the site, made from the code when the site is built.

Commands and options are dataclasses; their fields are walked as `tyro` walks them, so that flags,
defaults and words are those of ``semsfm COMMAND --help``. Nothing is written: `pages` returns
Markdown by the path of its page, which `site_hooks.py` adds to the site.

    python scripts/reference.py FOLDER     writes them there, to look at
"""

from __future__ import annotations

import dataclasses
import inspect
import re
import sys
import types
import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import griffe
import tyro

import semsfm_colmap
from semsfm_colmap.cli.commands import COMMANDS, Command
from semsfm_colmap.config import Config

ROOT = Path(__file__).parents[1]
OTHER_FORMS = {"map": ("--database_path",), "mesh": ("--colmap_path",)}
"""Commands that take other arguments once a flag is given: the flags."""
TYPES = (
    "AffineModel", "AffineTwoViewGeometry", "DepthMap", "DepthSign", "Features", "Observations",
    "OrthographicCameras", "PointCloud", "Reconstruction", "SemFrame", "SemMetadata", "SemSeries",
    "Solution", "TriangleMesh",
)  # fmt: skip
ERRORS = ("SemSfmError", "InputError", "UsageError", "MissingDependencyError")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Option:
    """One option of a command or of the configuration."""

    name: str
    """as on the command line without dashes, as in TOML with its section"""
    kind: str
    default: str
    words: str
    positional: bool = False


@dataclasses.dataclass(frozen=True, kw_only=True)
class Section:
    """Options of a command that are those of the configuration, or of a section of it."""

    kind: type
    prefix: str
    """of their flags, without dashes"""


class _Caught(Exception):  # noqa: N818
    """What a command was about to parse into."""


def arguments_of(command: Command, flags: tuple[str, ...] = ()) -> tuple[type, str]:
    """The dataclass that a command parses its arguments into, and its description."""
    real = tyro.cli

    def caught(kind: Any, **keywords: Any) -> Any:
        raise _Caught(kind, keywords.get("description") or "")

    tyro.cli = caught  # type: ignore[assignment]
    try:
        command.main()(list(flags))
    except _Caught as found:
        kind, description = found.args
        return kind, description
    finally:
        tyro.cli = real
    raise LookupError(f"semsfm {command.name} parses nothing with tyro.cli")


def words_of(kind: type, name: str) -> str:
    """The docstring below a field of a dataclass, or of the class it inherits the field from."""
    for base in kind.__mro__:
        if not base.__module__.startswith("semsfm_colmap"):
            continue
        try:
            found = griffe_module(base.__module__)[base.__qualname__].members.get(name)
        except KeyError:  # a class that the command made as it was called
            continue
        if found is not None and found.docstring is not None:
            return " ".join(found.docstring.value.split())
    return ""


_MODULES: dict[str, griffe.Module] = {}


def griffe_module(name: str) -> griffe.Module:
    """A module of the package as griffe reads its source."""
    if not _MODULES:
        _MODULES[""] = griffe.load("semsfm_colmap", search_paths=[str(ROOT)])
    inner = name.removeprefix("semsfm_colmap").lstrip(".")
    found = _MODULES[""][inner] if inner else _MODULES[""]
    assert isinstance(found, griffe.Module)
    return found


def unannotated(hint: Any) -> tuple[Any, tuple[Any, ...]]:
    """A type without its annotations, and these."""
    if typing.get_origin(hint) is typing.Annotated:
        return typing.get_args(hint)[0], typing.get_args(hint)[1:]
    return hint, ()


POSITIONAL = unannotated(tyro.conf.Positional[int])[1]
WITHOUT_PREFIX = unannotated(tyro.conf.OmitArgPrefixes[int])[1]


def said_type(hint: Any) -> str:
    """A type as a person writes it."""
    origin, args = typing.get_origin(hint), typing.get_args(hint)
    if origin is typing.Annotated:
        return said_type(args[0])
    if origin is typing.Literal:
        return ", ".join(str(value) for value in args)
    if origin in (typing.Union, types.UnionType):
        return " or ".join(said_type(arg) for arg in args if arg is not type(None))
    if origin in (tuple, list) or str(origin).endswith("Sequence"):
        inner = [said_type(arg) for arg in args if arg is not Ellipsis]
        return f"{inner[0]} ..." if Ellipsis in args or origin is list else ", ".join(inner)
    names = {float: "number", int: "integer", str: "text", bool: "on or off", Path: "path"}
    return names.get(hint) or getattr(hint, "__name__", str(hint))


def said_default(value: Any) -> str:
    """A default as it is written on the command line."""
    if value is dataclasses.MISSING:
        return "required"
    if value is None:
        return ""
    if isinstance(value, (tuple, list)):
        return " ".join(str(one) for one in value)
    return str(value)


def options_of(kind: type, value: Any = None, prefix: str = "") -> Iterator[Option | Section]:
    """The options of a dataclass; those of the configuration as sections."""
    hints = typing.get_type_hints(kind, include_extras=True)
    sections = {typing.get_type_hints(Config)[f.name] for f in dataclasses.fields(Config)}
    for field in dataclasses.fields(kind):
        hint, notes = unannotated(hints[field.name])
        default = field.default
        if value is not None:
            default = getattr(value, field.name)
        elif field.default_factory is not dataclasses.MISSING:
            default = field.default_factory()
        renamed = [note.name for note in notes if isinstance(getattr(note, "name", None), str)]
        name = renamed[0] if renamed else field.name
        if dataclasses.is_dataclass(hint):
            flat = not name or any(note in WITHOUT_PREFIX for note in notes)
            inner = prefix if flat else f"{prefix}{name}."
            if hint is Config or hint in sections:
                yield Section(kind=hint, prefix=inner)
            else:
                yield from options_of(hint, default, inner)
            continue
        extra = next((note.help for note in notes if getattr(note, "help", None)), "")
        choices = next((_choices(n) for n in notes if getattr(n, "constructor", None)), "")
        yield Option(
            name=prefix + name,
            kind=choices or said_type(hint),
            default=said_default(default),
            words=words_of(kind, field.name) or extra,
            positional=any(note in POSITIONAL for note in notes),
        )


def _choices(note: Any) -> str:
    literal = note.constructor
    return said_type(literal) if typing.get_origin(literal) is typing.Literal else ""


def cell(text: str) -> str:
    """Text as a cell of a Markdown table."""
    return re.sub(r"(?<!\\)\|", r"\\|", text).replace("<", "&lt;")


def option_table(options: list[Option]) -> str:
    """Options as a table."""
    lines = ["| option | takes | default | |", "|---|---|---|---|"]
    for one in options:
        name = one.name.upper() if one.positional else f"--{one.name}"
        default = f"`{one.default}`" if one.default not in ("", "required") else one.default
        lines.append(f"| `{name}` | {cell(one.kind)} | {cell(default)} | {cell(one.words)} |")
    return "\n".join(lines)


def command_section(command: Command, flags: tuple[str, ...] = ()) -> str:
    """A command: what it does, its usage and its own options."""
    kind, description = arguments_of(command, flags)
    found = list(options_of(kind))
    own = [one for one in found if isinstance(one, Option)]
    usage = " ".join(
        one.name.upper() if one.positional else f"--{one.name} {one.name.split('_')[0].upper()}"
        for one in own
        if one.positional or one.default == "required"
    )
    title = f"semsfm {command.name}" + "".join(f" {flag}" for flag in flags)
    parts = [
        f"{'###' if flags else '##'} {title}",
        f"```text\nsemsfm {command.name} {usage} [options]\n```",
        described(description),
        option_table(own),
    ]
    wider = [one for one in found if isinstance(one, Section)]
    if any(one.kind is Config for one in wider):
        parts.append("and all options of the [configuration](options.md).")
    elif wider:
        names = {typing.get_type_hints(Config)[f.name]: f.name for f in dataclasses.fields(Config)}
        said = ", ".join(
            f"[{names[one.kind]}](options.md#{names[one.kind]}) as `--{one.prefix}...`"
            for one in wider
        )
        parts.append(f"and the options of {said}.")
    return "\n\n".join(part for part in parts if part)


def described(description: str) -> str:
    """A description of the command line in Markdown: what is indented is code."""
    blocks = []
    for block in description.strip().split("\n\n"):
        lines = block.splitlines()
        if all(line.startswith("  ") for line in lines):
            code = "\n".join(line[2:] for line in lines)
            blocks.append(f"```text\n{code}\n```")
        elif any(line.startswith("  ") for line in lines):
            blocks.append(f"```text\n{block}\n```")
        else:
            blocks.append(" ".join(lines).replace("<", "&lt;"))
    return "\n\n".join(blocks)


def commands_page() -> str:
    """All commands with their options."""
    rows = [
        f"| [`{command.name}`](#semsfm-{command.name}) | {cell(command.help)} |"
        for command in COMMANDS
    ]
    sections = []
    for command in COMMANDS:
        sections.append(command_section(command))
        sections.extend(command_section(command, (f,)) for f in OTHER_FORMS.get(command.name, ()))
    head = (
        "# Commands\n\n`semsfm COMMAND --help` says the same. Flags are spelt as COLMAP's; those "
        "that are on or off also come as `--no_...`. Exit codes: 0 done, 1 the data do not allow "
        "it (one sentence says why), 2 the command is wrong, 130 stopped by Ctrl-C."
    )
    return "\n\n".join([head, "| command | |\n|---|---|\n" + "\n".join(rows), *sections]) + "\n"


def options_page() -> str:
    """Every key of the configuration file, by section."""
    config = Config()
    parts = [
        "# Options",
        "The stages take these as flags (`--matching.max_error_px 1.5`) or from a TOML file "
        "(`--config_path options.toml`); flags win over the file, the file over the defaults. "
        "`PROJECT/semsfm.toml` holds the resolved ones. Unknown keys are refused. The flags of "
        "`ingest` have no prefix on the command line: `--pixel_size_um`.",
        '```toml title="options.toml"\nseed = 3\n\n[ingest]\npixel_size_um = 0.0405\n\n'
        "[matching]\nmax_error_px = 1.5\n```",
    ]
    single: list[Option] = []
    hints = typing.get_type_hints(Config)
    for field in dataclasses.fields(Config):
        value = getattr(config, field.name)
        if not dataclasses.is_dataclass(value):
            words = words_of(Config, field.name)
            kind = said_type(hints[field.name])
            single.append(
                Option(name=field.name, kind=kind, default=said_default(value), words=words)
            )
            continue
        section = options_of(type(value), value)
        rows = [
            f"| `{one.name}` | {cell(one.kind)} | "
            f"{cell(f'`{one.default}`' if one.default else '')} | {cell(one.words)} |"
            for one in section
            if isinstance(one, Option)
        ]
        parts += [
            f"## {field.name}",
            words_of(Config, field.name) + ".",
            "| key | takes | default | |\n|---|---|---|---|\n" + "\n".join(rows),
        ]
    parts += ["## Without a section", option_table(single).replace("`--", "`")]
    return "\n\n".join(parts) + "\n"


def python_page() -> str:
    """The public names, by mkdocstrings."""
    names = [name for name in semsfm_colmap.__all__ if name != "__version__"]
    functions = [name for name in names if not inspect.isclass(getattr(semsfm_colmap, name))]
    classes = [name for name in names if name not in functions]
    parts = [
        # a search shall find words before names
        "---\nsearch:\n  boost: 0.3\n---",
        "# Python",
        "The names that `import semsfm_colmap` gives, and the types they take and return. Paths "
        "may be strings. What the data do not allow raises `InputError`, misuse `UsageError`.",
        "## Functions",
        *(f"::: semsfm_colmap.{name}" for name in functions),
        "## Options",
        *(f"::: semsfm_colmap.{name}" for name in classes),
        "## Types",
        *(f"::: semsfm_colmap.types.{name}" for name in TYPES),
        "## Errors",
        *(f"::: semsfm_colmap.errors.{name}" for name in ERRORS),
    ]
    return "\n\n".join(parts) + "\n"


def pages() -> dict[str, str]:
    """Markdown by the path of its page in the site."""
    return {
        "reference/commands.md": commands_page(),
        "reference/options.md": options_page(),
        "reference/python.md": python_page(),
    }


def main(folder: Path) -> None:
    """Write the pages below a folder."""
    for name, text in pages().items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
