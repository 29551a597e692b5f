import os

import pytest

from semsfm_colmap.pipeline import fingerprint as module
from semsfm_colmap.pipeline.fingerprint import content, fingerprint

OLD = 1_600_000_000


@pytest.fixture
def file(tmp_path, monkeypatch):
    """A file that nobody has touched for a while."""
    path = tmp_path / "table.csv"
    path.write_text("image,tilt_deg\na,1\n")
    monkeypatch.setattr(module, "SETTLED_NS", -1)
    return path


def test_a_file_that_was_not_touched_is_not_read_again(file, monkeypatch):
    found = fingerprint(file)
    monkeypatch.setattr(module, "hash_file", lambda path: pytest.fail("it was read"))
    assert fingerprint(file, found) == found


@pytest.mark.parametrize("way", ["in place", "renamed over it"])
def test_other_content_of_the_same_size_and_time_is_seen(file, way):
    os.utime(file, (OLD, OLD))
    found = fingerprint(file)
    other = file.with_name("other") if way == "renamed over it" else file
    other.write_text("image,tilt_deg\na,2\n")
    os.utime(other, (OLD, OLD))
    other.rename(file)
    assert (file.stat().st_mtime, file.stat().st_size) == (OLD, len("image,tilt_deg\na,1\n"))
    assert content(fingerprint(file, found)) != content(found)


def test_a_copy_elsewhere_has_the_same_content(file, tmp_path):
    copy = tmp_path / "copy.csv"
    copy.write_bytes(file.read_bytes())
    assert content(fingerprint(copy)) == content(fingerprint(file))


def test_what_was_changed_a_moment_ago_is_read_again_whatever_its_stamp_says(file, monkeypatch):
    monkeypatch.setattr(module, "SETTLED_NS", 10**12)
    found = fingerprint(file)
    calls = []
    monkeypatch.setattr(module, "hash_file", lambda path: calls.append(path) or "other")
    assert content(fingerprint(file, found)) == "other"
    assert calls == [file]
