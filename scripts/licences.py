"""The licences of everything that `pip install semsfm-colmap` and its extras bring along.

    python scripts/licences.py                       a table, as Markdown
    python scripts/licences.py --write docs/licences.md    the same, between the page's markers
    python scripts/licences.py --check               exit code 1 where one is none that may be here

What is installed is looked at, in the environment that runs this: the package's requirements with
all extras but `dev`, and theirs. A licence is what the distribution's metadata say (the expression,
else the classifiers, else the field). GPL and AGPL are refused, and what says nothing; LGPL and MPL
are noted, as they ask something of who changes the library itself.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path
from typing import Literal

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = "semsfm-colmap"
BEGIN, END = "<!-- licences: python scripts/licences.py -->", "<!-- end of licences -->"
MAX_FIELD = 60
"""A field that is longer is the text of a licence, not its name."""
KNOWN_TEXTS: Mapping[str, str] = {}
"""Licences of distributions whose metadata name none, read in their files."""

Kind = Literal["permissive", "weak copyleft", "copyleft", "unknown"]


def needed(name: str = ROOT) -> list[Distribution]:
    """All distributions that one asks for, through others too, as far as they are installed."""
    found: dict[str, Distribution] = {}
    extras = set(distribution(name).metadata.get_all("Provides-Extra") or ()) - {"dev"}
    todo = [(name, frozenset({"", *extras}))]
    seen: set[tuple[str, frozenset[str]]] = set()
    while todo:
        key = todo.pop()
        if key in seen:
            continue
        seen.add(key)
        try:
            here = distribution(key[0])
        except PackageNotFoundError:
            continue
        found[canonicalize_name(key[0])] = here
        for text in here.requires or ():
            requirement = Requirement(text)
            marker = requirement.marker
            if marker is None or any(marker.evaluate({"extra": one}) for one in key[1]):
                todo.append((requirement.name, frozenset({"", *requirement.extras})))
    found.pop(canonicalize_name(name), None)
    return [found[key] for key in sorted(found)]


def licence_of(dist: Distribution) -> str:
    """What a distribution says of its licence; empty where it says nothing."""
    metadata = dist.metadata
    name = canonicalize_name(metadata["Name"])
    if name in KNOWN_TEXTS:
        return KNOWN_TEXTS[name]
    if metadata.get("License-Expression"):
        return str(metadata["License-Expression"])
    classifiers = [
        line.rsplit(" :: ", 1)[1]
        for line in metadata.get_all("Classifier") or ()
        if line.startswith("License ::") and not line.endswith("OSI Approved")
    ]
    if classifiers:
        return "; ".join(classifiers)
    field = (metadata.get("License") or "").strip().splitlines()
    return field[0] if field and len(field[0]) <= MAX_FIELD else ""


def kind_of(licence: str) -> Kind:
    """What a licence asks for; of a choice (OR) the mildest part counts, of a sum the strictest."""
    if not licence or licence.upper() in ("UNKNOWN", "LICENSE", "OTHER/PROPRIETARY LICENSE"):
        return "unknown"
    order: tuple[Kind, ...] = ("permissive", "weak copyleft", "copyleft")
    choices = [
        max((_kind_of_one(part) for part in re.split(r"\bAND\b|;", choice)), key=order.index)
        for choice in re.split(r"\bOR\b", licence)
    ]
    return min(choices, key=order.index)


def _kind_of_one(text: str) -> Kind:
    plain = re.sub(r"\bWITH\b.*exception.*", "", text, flags=re.IGNORECASE)
    if re.search(r"LGPL|Lesser|MPL|Mozilla|EPL|Eclipse", plain, re.IGNORECASE):
        return "weak copyleft"
    if re.search(r"A?GPL|General Public", plain, re.IGNORECASE):
        # with an exception for what is linked or run, as that of GCC's runtime
        return "copyleft" if plain == text else "weak copyleft"
    return "permissive"


def table(dists: Sequence[Distribution]) -> str:
    """A row a distribution: name, licence, kind."""
    rows = ["| package | licence | kind |", "|---|---|---|"]
    for dist in dists:
        licence = licence_of(dist)
        rows.append(f"| {dist.metadata['Name']} | {licence or 'none named'} | {kind_of(licence)} |")
    return "\n".join(rows)


def problems(dists: Sequence[Distribution]) -> Iterator[str]:
    """A sentence for each that may not be installed by default."""
    for dist in dists:
        licence = licence_of(dist)
        kind = kind_of(licence)
        name = dist.metadata["Name"]
        if kind == "copyleft":
            yield f"{name} is under {licence}: nothing such may be installed by default"
        elif kind == "unknown":
            yield f"{name} names no licence: look into its files, and add it to KNOWN_TEXTS"


def write(page: Path, rows: str) -> None:
    """Put a table between the markers of a page."""
    text = page.read_text(encoding="utf-8")
    head, rest = text.split(BEGIN)
    page.write_text(f"{head}{BEGIN}\n\n{rows}\n\n{END}{rest.split(END)[1]}", encoding="utf-8")


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--check", action="store_true", help="say what may not be here")
    parser.add_argument("--write", type=Path, help="page with the markers")
    given = parser.parse_args()
    dists = needed()
    if given.check:
        found = list(problems(dists))
        print("\n".join(found), end="\n" if found else "")
        return 1 if found else 0
    if given.write is not None:
        write(given.write, table(dists))
    else:
        print(table(dists))
    return 0


if __name__ == "__main__":
    sys.exit(main())
