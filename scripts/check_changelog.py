"""Is the changelog as it should be?

    python scripts/check_changelog.py [FILE]

It has a title, then sections: Unreleased, which collects what the next version brings, and below it
the released versions with their dates, the newest first:

    ## Unreleased

    ### Added
    - A sentence, which goes on in lines
      that are indented by two spaces.

    ## 0.1.0 - 2026-11-29

The newest of these is not newer than semsfm_colmap/version.py, the one place of the version; a
commit that git has a tag for, such as v0.1.0, has that version in both.

In a section the headings are Added, Changed, Fixed and Breaking, each at most once and with entries
below it. Prints what is wrong, line by line, and ends with exit code 1 where anything is.
"""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from datetime import date
from pathlib import Path

HEADINGS = ("Added", "Changed", "Fixed", "Breaking")
MAX_LENGTH = 102
"""The longest line when this check began; 100 is enough."""
RELEASE = re.compile(r"(\d+)\.(\d+)\.(\d+) - (\d{4}-\d\d-\d\d)")

Problem = tuple[int, str]


def problems(text: str) -> list[Problem]:
    """Number of the line and what is wrong with it, for everything that is."""
    lines = list(enumerate(text.splitlines(), 1))
    found = [*wrong_lines(lines), *wrong_sections(lines), *wrong_headings(lines)]
    return sorted(found)


def wrong_lines(lines: list[tuple[int, str]]) -> Iterator[Problem]:
    """Lines by themselves: the title, their length, what they begin with."""
    if not lines or lines[0][1] != "# Changelog":
        yield 1, "the first line is '# Changelog'"
    for number, line in lines[1:]:
        if len(line) > MAX_LENGTH:
            yield number, f"{len(line)} characters, at most {MAX_LENGTH} are allowed"
        if line and not line.startswith(("## ", "### ", "- ", "  ")):
            yield number, "neither a heading, nor an entry ('- '), nor the rest of one ('  ')"


def wrong_sections(lines: list[tuple[int, str]]) -> Iterator[Problem]:
    """Unreleased on top, then versions with dates, the newest first."""
    sections = [(number, line[3:]) for number, line in lines if line.startswith("## ")]
    if not sections or sections[0][1] != "Unreleased":
        yield sections[0][0] if sections else 1, "the first section is '## Unreleased'"
    newer: tuple[tuple[int, ...], date] | None = None
    for number, title in sections:
        if title == "Unreleased":
            if number != sections[0][0]:
                yield number, "Unreleased is the first section, and there is one"
            continue
        match = RELEASE.fullmatch(title)
        try:
            if match is None:
                raise ValueError
            this = (tuple(map(int, match.groups()[:3])), date.fromisoformat(match[4]))
        except ValueError:
            yield number, f"'{title}' is not a version with its date, such as 0.1.0 - 2026-11-29"
            continue
        if newer and not (this[0] < newer[0] and this[1] <= newer[1]):
            yield number, f"{title} stands below an older version, or one of the same number"
        newer = this


def wrong_headings(lines: list[tuple[int, str]]) -> Iterator[Problem]:
    """Known headings, once a section, with entries; no entry without a heading."""
    seen: set[str] = set()
    open_heading: int | None = None
    in_heading = False
    for number, line in [*lines, (len(lines) + 1, "## ")]:
        if line.startswith(("## ", "### ")):
            if open_heading is not None:
                yield open_heading, "a heading without an entry"
            open_heading = None
            in_heading = line.startswith("### ")
        if line.startswith("## "):
            seen = set()
        elif line.startswith("### "):
            title = line[4:]
            if title not in HEADINGS:
                yield number, f"'{title}' is none of {', '.join(HEADINGS)}"
            if title in seen:
                yield number, f"{title} stands twice in its section"
            seen.add(title)
            open_heading = number
        elif line.startswith("- "):
            if not in_heading:
                yield number, f"an entry without one of the headings {', '.join(HEADINGS)}"
            open_heading = None


def wrong_version(text: str, version: str, tags: list[str]) -> Iterator[Problem]:
    """Version, tags of this commit and newest released section say the same."""
    found = [(k, m[0].split()[0]) for k, line in enumerate(text.splitlines(), 1)
             if line.startswith("## ") and (m := RELEASE.fullmatch(line[3:]))]  # fmt: skip
    number, newest = found[0] if found else (1, "")
    if found and numbers(newest) > numbers(version):
        yield number, f"{newest} is newer than semsfm_colmap/version.py, which says {version}"
    for tag in tags:
        if not tag[1:] == version == newest:
            newest = newest or "none"
            yield number, f"tag {tag}, semsfm_colmap/version.py {version}, newest section {newest}"


def numbers(version: str) -> tuple[int, ...]:
    """(0, 1, 0) of 0.1.0."""
    return tuple(map(int, version.split(".")))


def main() -> int:
    root = Path(__file__).parents[1]
    path = Path(sys.argv[1] if len(sys.argv) > 1 else root / "CHANGELOG.md")
    text = path.read_text(encoding="utf-8")
    stated = re.search(r'__version__ = "(.+)"', (root / "semsfm_colmap/version.py").read_text())
    asked = ["git", "-C", str(root), "tag", "--points-at", "HEAD", "--list", "v[0-9]*"]
    tags = subprocess.run(asked, capture_output=True, text=True).stdout.split()
    assert stated is not None
    found = sorted([*problems(text), *wrong_version(text, stated[1], tags)])
    for number, sentence in found:
        print(f"{path.name}:{number}: {sentence}")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
