"""The licences of what is installed by default."""

from __future__ import annotations

from email.message import Message

import pytest

from scripts.licences import BEGIN, END, kind_of, licence_of, needed, problems, table, write


class Dist:
    """A distribution as far as its metadata go."""

    def __init__(self, **fields: str) -> None:
        self.metadata = Message()
        self.metadata["Name"] = "some"
        for name, value in fields.items():
            self.metadata[name.replace("_", "-")] = value


@pytest.mark.parametrize(
    ("licence", "kind"),
    [
        ("MIT", "permissive"),
        ("BSD License", "permissive"),
        ("MIT AND PSF-2.0", "permissive"),
        ("LGPL-3.0-or-later", "weak copyleft"),
        ("GNU Lesser General Public License v3 (LGPLv3)", "weak copyleft"),
        ("Mozilla Public License 2.0 (MPL 2.0)", "weak copyleft"),
        ("GPL-3.0-only", "copyleft"),
        ("GNU Affero General Public License v3", "copyleft"),
        ("AGPL-3.0", "copyleft"),
        ("MIT AND GPL-3.0-only", "copyleft"),
        ("BSD License; GNU General Public License v2 (GPLv2)", "copyleft"),
        ("MIT OR GPL-3.0-only", "permissive"),
        ("BSD-3-Clause AND GPL-3.0-or-later WITH GCC-exception-3.1", "weak copyleft"),
        ("", "unknown"),
        ("UNKNOWN", "unknown"),
    ],
)
def test_the_kind_of_a_licence(licence, kind):
    assert kind_of(licence) == kind


def test_the_expression_comes_before_classifiers_and_those_before_the_field():
    both = {"Classifier": "License :: OSI Approved :: MIT License", "License": "a text"}
    assert licence_of(Dist(License_Expression="BSD-3-Clause", **both)) == "BSD-3-Clause"
    assert licence_of(Dist(**both)) == "MIT License"
    assert licence_of(Dist(License="a text")) == "a text"
    assert licence_of(Dist(License="all of the text " * 9)) == ""


def test_what_may_not_be_installed_is_said():
    found = [Dist(License="GPL-3.0"), Dist(), Dist(License="MIT"), Dist(License="LGPL-3.0")]
    said = list(problems(found))
    assert [word in line for word, line in zip(("GPL-3.0", "names no"), said, strict=True)]


def test_nothing_that_is_installed_by_default_is_under_the_gpl():
    dists = needed()
    names = {dist.metadata["Name"].lower() for dist in dists}
    assert {"numpy", "pycolmap", "pydantic-core"} <= {name.replace("_", "-") for name in names}
    assert "mkdocs" not in names
    assert list(problems(dists)) == []


def test_only_what_is_between_the_markers_is_replaced(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(f"before\n{BEGIN}\nold\n{END}\nafter\n")
    write(page, table([Dist(License="MIT")]))
    assert page.read_text().startswith(f"before\n{BEGIN}\n\n| package")
    assert page.read_text().endswith(f"| some | MIT | permissive |\n\n{END}\nafter\n")
