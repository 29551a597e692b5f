from __future__ import annotations

import pytest
from packaging.version import Version

from semsfm_colmap.deprecation import (
    DEPRECATIONS,
    Deprecation,
    overdue,
    warn_deprecated,
)
from semsfm_colmap.version import __version__

OLD = Deprecation(name="--old", instead="--new", since="0.2.0", removed_in="0.3.0")


def test_nothing_outlives_the_version_that_it_is_removed_in():
    assert overdue(DEPRECATIONS, __version__) == []


@pytest.mark.parametrize("version", ["0.3.0", "0.3.1", "0.10.0", "1.0.0"])
def test_what_is_still_there_when_its_version_has_come_is_overdue(version):
    assert overdue([OLD], version) == [OLD]


@pytest.mark.parametrize("version", ["0.1.0", "0.2.0", "0.2.10"])
def test_what_still_warns_is_not_overdue(version):
    assert overdue([OLD], version) == []


def test_the_warning_names_the_version_and_what_takes_its_place_at_the_line_of_the_caller():
    def function() -> None:
        warn_deprecated("--old", [OLD])

    with pytest.warns(FutureWarning, match=r"--old goes away in semsfm 0\.3\.0: --new") as seen:
        function()
    assert seen[0].filename == __file__


@pytest.mark.parametrize("removed_in", ["0.2.0", "0.2.5", "0.1.0"])
def test_a_thing_is_not_taken_away_within_the_minor_version_that_began_to_warn(removed_in):
    with pytest.raises(ValueError, match="no release after"):
        Deprecation(name="--old", instead="--new", since="0.2.0", removed_in=removed_in)


def test_the_version_is_a_semantic_one():
    release = Version(__version__).release
    assert len(release) == 3
    assert __version__.startswith(".".join(map(str, release)))
