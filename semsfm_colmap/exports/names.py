"""Image names: which a format can hold, and plain ones for those it cannot."""

from __future__ import annotations

import posixpath
from collections.abc import Sequence
from dataclasses import dataclass

from semsfm_colmap.errors import InputError


@dataclass(frozen=True, kw_only=True)
class NameRule:
    """What an image name must not have in a format."""

    characters: str = ""
    """None of these anywhere."""
    no_whitespace: bool = False
    """No white space at all: the format separates fields by it."""
    no_outer_whitespace: bool = False
    """None at the ends: readers trim lines."""
    no_leading: str = ""
    """Not one of these first: it starts a comment."""

    def fault(self, name: str) -> str | None:
        """Why the format cannot hold a name, or None."""
        if "\n" in name or "\r" in name:
            return "has a line break"
        if self.no_whitespace and any(c.isspace() for c in name):
            return "has white space"
        if self.no_outer_whitespace and name != name.strip():
            return "begins or ends with white space"
        for character in self.characters:
            if character in name:
                return f"has a {character!r}"
        if self.no_leading and name[:1] in self.no_leading:
            return f"begins with {name[0]!r}"
        return None


ANY_NAME = NameRule()
NO_SPACES = NameRule(no_whitespace=True)
"""COLMAP's text reader, OpenMVS, NVM and Bundler's list end a name at white space."""
LIST_NAME = NameRule(characters=",", no_outer_whitespace=True, no_leading="#")
"""patch-match.cfg separates names by commas, trims lines and skips those that begin with #."""


def check_names(names: Sequence[str], rule: NameRule, format_name: str) -> None:
    """Refuse the first name that a format cannot hold, with the way out."""
    for name in names:
        fault = rule.fault(name)
        if fault is not None:
            raise InputError(
                f"{format_name} cannot hold the image name {name!r}, which {fault}: add "
                "--plain_names to copy the images under plain names, or rename them"
            )


def plain_names(names: Sequence[str]) -> tuple[str, ...]:
    """``image_0001.png``, ... in the order of the images, each with its own ending."""
    return tuple(f"image_{i + 1:04d}{posixpath.splitext(n)[1]}" for i, n in enumerate(names))
