"""What goes away: said for one release at least, then gone.

Versions are semantic: MAJOR.MINOR.PATCH. While MAJOR is 0 a raised MINOR may take a public name, an
option, a command or a value away, from 1.0 on only a raised MAJOR may. Before that a release that
still has it warns, and names the version without it. A project's files are no part of this: those
of every version are read (`io/versions.py`).

To deprecate a thing: a line in `DEPRECATIONS`, and `warn_deprecated(its name)` where it is used. A
test fails when the version that removes it has come and the line still stands.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from dataclasses import dataclass

from packaging.version import Version

from semsfm_colmap.version import __version__


@dataclass(frozen=True, kw_only=True)
class Deprecation:
    """A thing that goes away."""

    name: str
    """as its users write it"""
    instead: str
    """what to write in its place"""
    since: str
    """the first version that warns"""
    removed_in: str
    """the first version without it, a later minor or major one"""

    def __post_init__(self) -> None:
        """Refuse what gives nobody a release to change over."""
        if Version(self.removed_in).release[:2] <= Version(self.since).release[:2]:
            raise ValueError(f"{self.name}: {self.removed_in} is no release after {self.since}")


DEPRECATIONS: tuple[Deprecation, ...] = ()
"""All that warns now."""


def warn_deprecated(name: str, known: Iterable[Deprecation] = DEPRECATIONS) -> None:
    """Warn who uses a thing that goes away, at the line that calls what uses it.

    A `FutureWarning`, as Python shows that to who runs a program, too.
    """
    this = next(one for one in known if one.name == name)
    warnings.warn(
        f"{name} goes away in semsfm {this.removed_in}: {this.instead} takes its place",
        FutureWarning,
        stacklevel=3,
    )


def overdue(known: Iterable[Deprecation], version: str = __version__) -> list[Deprecation]:
    """What a version should not have any more."""
    release = Version(version).release
    return [one for one in known if release >= Version(one.removed_in).release]
