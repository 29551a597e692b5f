"""Whatever fails for want of space says so in one sentence and leaves nothing half-written."""

import errno
import os
import subprocess
import sys

import numpy as np
import pytest

from semsfm_colmap.colmap.database.images import register_images
from semsfm_colmap.colmap.database.work import read_matches, write_matches
from semsfm_colmap.errors import DiskFullError, InputError
from semsfm_colmap.io import disk
from semsfm_colmap.io.atomic import file_aside, folder_aside, write_json
from semsfm_colmap.io.disk import full_disk_is_said, require_space
from tests.ingest.images import save, texture


@pytest.fixture
def full(monkeypatch):
    """A disk with nothing left on it."""
    monkeypatch.setattr(disk, "_free_bytes", lambda path: 0)


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT, errno.EFBIG])
@pytest.mark.parametrize("aside_of", [file_aside, folder_aside])
def test_a_write_without_space_leaves_nothing(tmp_path, aside_of, number):
    def write():
        with aside_of(tmp_path / "out") as aside:
            (aside / "part" if aside.is_dir() else aside).write_bytes(b"half")
            raise OSError(number, os.strerror(number))

    with pytest.raises(DiskFullError, match=r"the disk is full.*run the same command again"):
        write()
    assert list(tmp_path.iterdir()) == []


def test_what_a_library_says_of_a_full_disk_does_not_matter(tmp_path, full):
    with pytest.raises(DiskFullError), full_disk_is_said(tmp_path):
        raise RuntimeError("expected 12 faces but 0 were read")
    assert DiskFullError.exit_code == 2


def test_other_errors_stay_what_they_are(tmp_path):
    with pytest.raises(InputError, match="too few"), full_disk_is_said(tmp_path):
        raise InputError("too few images")
    with pytest.raises(PermissionError), full_disk_is_said(tmp_path):
        raise PermissionError(errno.EACCES, "Permission denied")


def test_an_error_that_a_full_disk_led_to_counts(tmp_path):
    def write():
        try:
            raise OSError(errno.ENOSPC, "No space left on device")
        except OSError as error:
            raise InputError("no such thing") from error

    with pytest.raises(DiskFullError), full_disk_is_said(tmp_path):
        write()


def test_space_is_required_before_a_transaction_begins(tmp_path, monkeypatch):
    path = tmp_path / "database.db"
    register_images(path, ["a.png", "b.png"], [(64, 48)] * 2)
    monkeypatch.setattr(disk, "_free_bytes", lambda path: 1 << 17)
    with pytest.raises(DiskFullError):
        write_matches(path, {(1, 2): np.zeros((9, 2), dtype=np.int64)})
    assert read_matches(path) == {}
    monkeypatch.setattr(disk, "_free_bytes", lambda path: 1 << 20)
    write_matches(path, {(1, 2): np.zeros((9, 2), dtype=np.int64)})
    require_space(path, 1 << 20)
    with pytest.raises(DiskFullError):
        require_space(path, (1 << 20) + 1)


def test_json_on_a_full_disk_is_said_so(tmp_path, monkeypatch):
    def no_space(handle):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", no_space)
    with pytest.raises(DiskFullError, match=r"run\.json: the disk is full"):
        write_json({}, tmp_path / "run.json")


@pytest.mark.parametrize("kilobytes", [4, 60])
def test_a_limit_of_file_sizes_ends_a_command_in_one_sentence(tmp_path, kilobytes):
    for k in range(3):
        save(tmp_path / "images" / f"{k}.png", texture(k))
    code = (
        "import resource, sys; from semsfm_colmap.cli.main import main; "
        f"resource.setrlimit(resource.RLIMIT_FSIZE, ({kilobytes} << 10,) * 2); "
        "sys.exit(main(['extract', 'images', '--output_path', 'p', '-q']))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    said = [line for line in done.stderr.splitlines() if not line.startswith("warning: ")]
    assert done.returncode == 2, done.stderr
    assert len(said) == 1
    assert "`ulimit -f` allows" in said[0]
    assert [p.name for p in tmp_path.rglob(".*")] == [".semsfm.lock"]


def test_what_is_renamed_has_reached_the_disk_before(tmp_path, monkeypatch):
    order = []
    fsync, replace = os.fsync, os.replace
    monkeypatch.setattr(
        os, "fsync", lambda handle: order.append(os.readlink(f"/proc/self/fd/{handle}"))
    )
    monkeypatch.setattr(os, "replace", lambda a, b: (order.append("renamed"), replace(a, b)))
    with file_aside(tmp_path / "out") as aside:
        aside.write_bytes(b"whole")
    assert order == [str(tmp_path / ".out.part"), "renamed", str(tmp_path)]
    assert fsync is not os.fsync
