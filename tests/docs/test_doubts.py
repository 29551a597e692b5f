"""The tutorial has a section on every doubt of the report, in the words of the report."""

from __future__ import annotations

import ast
import re

from tests.docs.blocks import ROOT

SOURCES = sorted(ROOT.glob("semsfm_colmap/report/doubts*.py"))
PAGE = ROOT / "docs/tutorial/doubts.md"


def words(text: str) -> set[str]:
    """The words of a text, in lower case, singular and plural alike."""
    return {word.rstrip("s") for word in re.findall(r"[a-z]{2,}", text.lower())}


def doubts() -> list[set[str]]:
    """The words of each doubt: of its sentence, and of its title where it has one."""
    calls = [
        node
        for source in SOURCES
        for node in ast.walk(ast.parse(source.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Name)
        and node.func.id in ("Doubt", "Cause")
    ]
    said = [[k.value for k in call.keywords if k.arg in ("title", "sentence")] for call in calls]
    found = [
        words(
            " ".join(
                str(node.value)
                for part in parts
                for node in ast.walk(part)
                if isinstance(node, ast.Constant)
            )
        )
        for parts in said
    ]
    return [one for one in found if one]  # that of a cause has the cause's words


def test_every_doubt_has_a_section_and_every_section_is_of_a_doubt():
    sections = re.findall(r"^## (.*)$", PAGE.read_text(encoding="utf-8"), re.M)
    found = doubts()
    assert len(found) > 10
    without_doubt = [s for s in sections if not any(words(s) <= doubt for doubt in found)]
    assert without_doubt == []
    assert [d for d in found if not any(words(s) <= d for s in sections)] == []
    assert len(sections) == len(found)
