"""The docstrings of this package, as the site's generator and the checks read them.

The house writes a parameter on one line, ``name : words``, and what is returned as words alone;
numpydoc would take both for types, which the signature has already. `numpydoc` rewrites the
sections so, and as an extension of griffe it does so for every object of the site.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import griffe

HEADING = re.compile(r"^([A-Z][A-Za-z ]+)\n(-{3,})$", re.MULTILINE)


def sections(docstring: str) -> list[tuple[str, str]]:
    """Title and text of each section of a dedented docstring; the head has no title."""
    parts = HEADING.split(docstring)
    found = [("", parts[0])]
    found += [(parts[k], parts[k + 2].strip("\n")) for k in range(1, len(parts), 3)]
    return found


def entries(text: str) -> list[tuple[str, str]]:
    """Name and words of each entry of a section: ``name : words`` or words indented below."""
    found: list[tuple[str, list[str]]] = []
    for line in text.splitlines():
        if line and not line.startswith(" "):
            name, _, words = line.partition(" : ")
            found.append((name.strip(), [words]))
        elif found:
            found[-1][1].append(line.strip())
    return [(name, " ".join(words).strip()) for name, words in found]


def numpydoc(docstring: str, returns: str = "") -> str:
    """The same docstring with the sections as numpydoc has them.

    Parameters
    ----------
    returns : type of what is returned, as the signature has it

    """
    rewritten: dict[str, Callable[[str], str]] = {
        "Parameters": _indented,
        "Raises": _indented,
        "Returns": lambda text: f"{returns}\n" + re.sub("^(?=.)", "    ", text, flags=re.M),
    }
    parts = []
    for title, text in sections(docstring):
        body = rewritten[title](text) if title in rewritten else text
        parts.append(f"{title}\n{'-' * len(title)}\n{body}\n\n" if title else body)
    return "".join(parts).rstrip("\n")


def _indented(text: str) -> str:
    return "\n".join(f"{name}\n    {words}" for name, words in entries(text))


class HouseDocstrings(griffe.Extension):
    """Rewrites the docstrings of all functions that griffe loads."""

    def on_function(self, *, func: griffe.Function, **_: Any) -> None:
        """Rewrite the docstring of one."""
        if func.docstring is not None:
            returns = "" if func.returns is None else str(func.returns)
            func.docstring.value = numpydoc(func.docstring.value, returns)
