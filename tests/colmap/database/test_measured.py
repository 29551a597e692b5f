import functools
import sqlite3

import pytest

from semsfm_colmap.colmap.database import checks, side_tables
from semsfm_colmap.colmap.database.measured import read_num_measured, write_num_measured
from semsfm_colmap.colmap.database.work import read_images, read_keypoints
from semsfm_colmap.errors import InputError
from tests.colmap.databases import simulated_content, write_4x


@pytest.fixture
def database(tmp_path):
    path = tmp_path / "database.db"
    write_4x(path, simulated_content()[0])
    return path


def test_a_database_without_the_table_says_nothing(database):
    assert read_num_measured(database) is None


def test_counts_are_replaced_as_a_whole(database):
    write_num_measured(database, {1: 10, 2: 20, 3: 30})
    write_num_measured(database, {1: 11, 2: 0})
    assert read_num_measured(database) == {1: 11, 2: 0}


def test_colmap_reads_the_rest_as_before(database):
    images = read_images(database)
    before = read_keypoints(database, [i.image_id for i in images])
    write_num_measured(database, {image.image_id: 1 for image in images})
    assert [i.name for i in read_images(database)] == [i.name for i in images]
    after = read_keypoints(database, [i.image_id for i in images])
    assert all((before[k] == after[k]).all() for k in before)


def test_a_database_that_another_program_holds_is_one_sentence(database, monkeypatch):
    hasty = functools.partial(checks.check_writable, timeout_s=0.1)
    monkeypatch.setattr(side_tables, "check_writable", hasty)
    holder = sqlite3.connect(database, isolation_level=None)
    holder.execute("BEGIN EXCLUSIVE")
    with pytest.raises(InputError, match="in use by another program"):
        write_num_measured(database, {1: 1})
    holder.close()
