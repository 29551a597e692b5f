from __future__ import annotations

import pytest

from semsfm_colmap.ingest.metadata.xml import flatten_xml


def test_xml_is_flattened_without_its_root() -> None:
    values, problem = flatten_xml("<?xml version='1.0'?><M><A><B> 1 </B><B>2</B></A><C/></M>")
    assert (values, problem) == ({"A/B": "1"}, None)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ('<!DOCTYPE l [<!ENTITY a "aaaa">]><l>&a;</l>', "document type"),
        ("<a>" * 40 + "</a>" * 40, "levels"),
        ("<r>" + "<a/>" * 30_000 + "</r>", "elements"),
        ("<a><b></a>", "well-formed"),
        ("", "well-formed"),
    ],
    ids=["entities", "deep", "many", "broken", "empty"],
)
def test_hostile_xml_is_refused_with_a_reason(text: str, reason: str) -> None:
    values, problem = flatten_xml(text)
    assert values == {}
    assert problem is not None
    assert reason in problem
