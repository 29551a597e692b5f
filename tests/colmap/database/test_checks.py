import sqlite3

import pytest

from semsfm_colmap.colmap.database import checks as database_checks
from semsfm_colmap.colmap.database.checks import (
    check_writable,
    installed_version_number,
    version_text,
)
from semsfm_colmap.colmap.database.reader import read_database
from semsfm_colmap.colmap.database.work import open_database, read_images
from semsfm_colmap.colmap.library import pycolmap
from semsfm_colmap.errors import InputError
from tests.colmap.databases import simulated_content, write_4x, write_38


@pytest.fixture
def database(tmp_path):
    with pycolmap.Database.open(str(tmp_path / "d.db")):
        pass
    return tmp_path / "d.db"


@pytest.fixture
def impatient(monkeypatch):
    monkeypatch.setitem(check_writable.__kwdefaults__, "timeout_s", 0.05)


def set_version(path, number):
    db = sqlite3.connect(path)
    db.execute(f"PRAGMA user_version = {number}")
    db.commit()
    db.close()


def version(path):
    db = sqlite3.connect(path)
    number = db.execute("PRAGMA user_version").fetchone()[0]
    db.close()
    return number


def test_the_version_is_the_one_that_pycolmap_stamps(database):
    assert version(database) == installed_version_number()
    assert version_text(installed_version_number()) == pycolmap.__version__


@pytest.mark.parametrize("how", [open_database, read_database])
def test_a_newer_database_is_refused_and_keeps_its_version(database, how):
    newer = installed_version_number() + 1_000_000
    set_version(database, newer)
    sentence = r"written by COLMAP \d+\.\d+\.\d+, but pycolmap"
    with pytest.raises(InputError, match=sentence), how(database):
        pass
    assert version(database) == newer


@pytest.mark.parametrize("how", [open_database, read_database])
def test_another_programs_sqlite_file_is_left_alone(tmp_path, how):
    path = tmp_path / "firefox.sqlite"
    db = sqlite3.connect(path)
    db.execute("CREATE TABLE bookmarks (url TEXT)")
    db.commit()
    db.close()
    before = path.read_bytes()
    sentence = "not a COLMAP database: it has no table cameras"
    with pytest.raises(InputError, match=sentence), how(path):
        pass
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("how", [open_database, read_database])
def test_what_is_no_database_is_called_so(tmp_path, how):
    path = tmp_path / "a.db"
    path.write_bytes(b"JPEG" * 1000)
    with pytest.raises(InputError, match="no SQLite file"), how(path):
        pass
    with pytest.raises(InputError, match="does not exist"), how(tmp_path / "b.db"):
        pass


def test_a_folder_is_not_a_database(tmp_path):
    with pytest.raises(InputError, match="is a folder"), read_database(tmp_path):
        pass


def test_a_file_cut_short_is_called_damaged(tmp_path):
    content, _ = simulated_content(num_images=3)
    path = write_38(tmp_path / "d.db", content)
    path.write_bytes(path.read_bytes()[:6000])
    with pytest.raises(InputError, match=r"damaged|cannot be used"), read_database(path) as reader:
        reader.images()


def test_a_held_database_is_a_sentence_and_free_again_after(database, impatient):
    other = sqlite3.connect(database, isolation_level=None)
    other.execute("BEGIN IMMEDIATE")
    with pytest.raises(InputError, match=r"in use by another program \(COLMAP's GUI\?\)"):
        read_images(database)
    other.execute("ROLLBACK")
    other.close()
    assert read_images(database) == []


def test_a_short_transaction_of_another_program_is_waited_for(database):
    import threading
    import time

    other = sqlite3.connect(database, isolation_level=None, check_same_thread=False)
    other.execute("BEGIN IMMEDIATE")
    timer = threading.Timer(0.3, lambda: other.execute("ROLLBACK"))
    begin = time.monotonic()
    timer.start()
    assert read_images(database) == []
    assert time.monotonic() - begin >= 0.25
    timer.join()
    other.close()


def test_tables_that_a_killed_process_did_not_come_to_make_are_completed(tmp_path):
    path = tmp_path / "d.db"
    db = sqlite3.connect(path)
    db.execute("CREATE TABLE rigs (rig_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, "
               "ref_sensor_id INTEGER NOT NULL, ref_sensor_type INTEGER NOT NULL)")  # fmt: skip
    db.commit()
    db.close()
    with pytest.raises(InputError, match="no table"), open_database(path):
        pass
    with open_database(path, create=True) as opened:
        assert opened.num_images() == 0
    assert read_images(path) == []


def test_an_empty_file_is_a_database_to_be_made(tmp_path):
    path = tmp_path / "d.db"
    path.touch()
    with pytest.raises(InputError, match="does not exist"), open_database(path):
        pass
    with open_database(path, create=True) as opened:
        assert opened.num_images() == 0


def test_old_versions_pass_whatever_their_number(tmp_path):
    content, _ = simulated_content(num_images=3)
    for number in (0, 3700, 3800, 3900, 4090):
        path = write_38(tmp_path / f"{number}.db", content, version=number)
        with read_database(path) as reader:
            assert len(reader.images()) == 3


def test_every_table_of_colmaps_schema_is_known(tmp_path):
    path = write_4x(tmp_path / "d.db", simulated_content(num_images=3)[0])
    db = sqlite3.connect(path)
    tables = {r[0] for r in db.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
    db.close()
    assert tables == {*database_checks.TABLES, *database_checks.MORE_TABLES}
