"""Nothing that a killed process has left aside outlives the next run."""

import os
import subprocess
import sys

import pytest

from semsfm_colmap.io.temporary import (
    LOCK,
    remove_dead_folders,
    remove_leftovers,
    temporary_folder,
)

KILLED = (
    "import os, signal, sys; from pathlib import Path\n"
    "from semsfm_colmap.io.temporary import temporary_folder\n"
    "with temporary_folder(Path(sys.argv[1])) as folder:\n"
    "    (folder / 'features.db').write_bytes(b'half')\n"
    "    os.kill(os.getpid(), signal.SIGKILL)\n"
)


def names(path):
    return sorted(p.relative_to(path).as_posix() for p in path.rglob("*"))


def test_a_folder_of_a_killed_process_goes_and_one_in_use_stays(tmp_path):
    subprocess.run([sys.executable, "-c", KILLED, str(tmp_path)], check=False)
    assert sum(name.endswith("/features.db") for name in names(tmp_path)) == 1
    with temporary_folder(tmp_path) as mine:
        (mine / "x").write_bytes(b"")
        remove_dead_folders(tmp_path)
        assert names(tmp_path) == [mine.name, f"{mine.name}/{LOCK}", f"{mine.name}/x"]
    assert names(tmp_path) == []


@pytest.mark.parametrize(
    "name",
    [
        ".run.json.part",
        ".database.db.scratch.part",
        ".database.db.scratch.part-wal",
        "sparse/.0.part/points3D.bin",
        "dense/.depth_maps.part/a.npz",
        "dense/.semsfm-abc/a.npz",
        "images/below/.a.tif.part",
        "report/figures/.x.png.999999999.part",
    ],
)
def test_what_was_written_aside_is_removed(tmp_path, name):
    path = tmp_path / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(b"half")
    (tmp_path / "kept.part").write_bytes(b"mine")
    remove_leftovers(tmp_path)
    assert [p for p in tmp_path.rglob("*") if p.is_file()] == [tmp_path / "kept.part"]
    assert not [p for p in names(tmp_path) if "/." in p or p.startswith(".")]


def test_what_another_process_is_writing_stays(tmp_path):
    (tmp_path / f".view.html.{os.getpid()}.part").write_bytes(b"half")
    remove_leftovers(tmp_path)
    assert len(names(tmp_path)) == 1


def test_a_folder_that_was_moved_aside_and_has_no_successor_is_put_back(tmp_path):
    for name in ("sparse/.0.old", "sparse/.1.old", "sparse/1"):
        (tmp_path / name).mkdir(parents=True)
        (tmp_path / name / "points3D.bin").write_text(name)
    remove_leftovers(tmp_path)
    assert names(tmp_path / "sparse") == ["0", "0/points3D.bin", "1", "1/points3D.bin"]
    assert (tmp_path / "sparse/0/points3D.bin").read_text() == "sparse/.0.old"
    assert (tmp_path / "sparse/1/points3D.bin").read_text() == "sparse/1"
