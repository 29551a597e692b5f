import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

SCRIPT = Path(__file__).parents[2] / "scripts/check_changelog.py"
GOOD = """# Changelog

## Unreleased

### Added
- A thing that goes on
  in a second line.
- Another.

### Fixed
- A fault.

## 0.10.0 - 2026-12-24

### Breaking
- An option has another name.

## 0.9.1 - 2026-11-29

### Changed
- Faster.
"""


def load_script() -> ModuleType:
    spec = importlib.util.spec_from_file_location("check_changelog", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


script = load_script()


def test_a_good_changelog_has_no_problems():
    assert script.problems(GOOD) == []


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ("# Changelog\n", "# News\n", 1, "first line"),
        ("## Unreleased\n", "## 0.11.0 - 2026-12-25\n", 3, "first section"),
        ("## 0.10.0 - 2026-12-24", "## Unreleased", 13, "there is one"),
        ("## 0.10.0 - 2026-12-24", "## 0.10.0", 13, "not a version with its date"),
        ("## 0.10.0 - 2026-12-24", "## 0.10 - 2026-12-24", 13, "not a version with its date"),
        ("## 0.10.0 - 2026-12-24", "## 0.10.0 - 2026-13-24", 13, "not a version with its date"),
        ("## 0.9.1 - 2026-11-29", "## 0.10.0 - 2026-11-29", 18, "below an older version"),
        ("## 0.9.1 - 2026-11-29", "## 0.9.1 - 2026-12-29", 18, "below an older version"),
        ("### Fixed", "### Removed", 10, "is none of Added, Changed, Fixed, Breaking"),
        ("### Fixed", "### Added", 10, "stands twice"),
        ("- A fault.\n", "", 10, "without an entry"),
        ("### Changed\n", "", 20, "without one of the headings"),
        ("- A fault.", "A fault.", 11, "neither a heading"),
        ("- A fault.", f"- {'x' * script.MAX_LENGTH}", 11, "characters"),
    ],
)
def test_what_is_wrong_is_said_with_its_line(old, new, line, words):
    assert GOOD.count(old) == 1
    found = script.problems(GOOD.replace(old, new))
    assert any(number == line and words in sentence for number, sentence in found), found


def test_an_empty_file_is_no_changelog():
    assert [sentence for _, sentence in script.problems("")] == [
        "the first line is '# Changelog'",
        "the first section is '## Unreleased'",
    ]


@pytest.mark.parametrize(
    ("version", "tags", "words"),
    [
        ("0.10.0", [], []),
        ("0.11.0", [], []),
        ("0.10.0", ["v0.10.0"], []),
        ("0.9.1", [], ["0.10.0 is newer than"]),
        ("0.11.0", ["v0.11.0"], ["newest section 0.10.0"]),
        ("0.10.0", ["v0.9.9"], ["tag v0.9.9, semsfm_colmap/version.py 0.10.0"]),
    ],
)
def test_version_tag_and_newest_section_are_one(version, tags, words):
    found = [sentence for _, sentence in script.wrong_version(GOOD, version, tags)]
    assert len(found) == len(words)
    assert all(word in sentence for word, sentence in zip(words, found, strict=True))


def test_a_tag_without_a_section_is_told():
    (problem,) = script.wrong_version("# Changelog\n\n## Unreleased\n", "0.1.0", ["v0.1.0"])
    assert problem[1].endswith("newest section none")
