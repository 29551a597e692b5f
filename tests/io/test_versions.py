from __future__ import annotations

from pathlib import Path

import pytest

from semsfm_colmap.errors import InputError
from semsfm_colmap.io.versions import check_version

FILE = Path("some.json")


@pytest.mark.parametrize("content", [{"version": 1}, {"version": 2}, {"version": 3}])
def test_versions_up_to_the_newest_are_read(content):
    check_version(content, 3, FILE, "make it again")


def test_a_newer_version_is_refused_with_the_way_out():
    with pytest.raises(InputError, match=r"some\.json was written by a newer semsfm.*pip install"):
        check_version({"version": 4}, 3, FILE, "make it again")


@pytest.mark.parametrize("version", [0, -1, 1.0, "1", None, True, [1]])
def test_what_is_no_version_is_damage(version):
    with pytest.raises(InputError, match=r"some\.json is damaged .*: make it again"):
        check_version({"version": version}, 3, FILE, "make it again")


def test_a_file_without_a_version_is_damaged():
    with pytest.raises(InputError, match=r"version = None"):
        check_version({}, 3, FILE, "make it again")
