import numpy as np
import pytest

from semsfm_colmap.colmap.database.match_steps import (
    read_match_steps,
    stored_steps,
    write_match_steps,
)
from semsfm_colmap.colmap.database.work import read_matches
from semsfm_colmap.types import AffineTwoViewGeometry
from tests.colmap.databases import simulated_content, write_4x


@pytest.fixture
def database(tmp_path):
    path = tmp_path / "database.db"
    write_4x(path, simulated_content()[0])
    return path


def geometry(step):
    return AffineTwoViewGeometry(
        image_pair=(0, 1),
        keypoints=np.zeros((3, 2), dtype=np.int64),
        F=None,
        inlier=np.zeros(3, dtype=bool),
        residual_px=np.full(3, np.nan),
        step=step,
    )


def test_a_database_without_the_table_has_no_steps(database):
    assert read_match_steps(database) == {}


def test_steps_are_replaced_as_a_whole_and_the_smaller_id_comes_first(database):
    write_match_steps(database, [((1, 2), np.array([0, 3])), ((2, 3), np.array([1]))])
    write_match_steps(database, [((3, 1), np.array([3, 2, 1, 0]))])
    steps = read_match_steps(database)
    assert list(steps) == [(1, 3)]
    np.testing.assert_array_equal(steps[1, 3], [3, 2, 1, 0])


def test_colmap_reads_the_matches_as_before(database):
    before = read_matches(database)
    write_match_steps(database, [(pair, np.zeros(len(rows))) for pair, rows in before.items()])
    after = read_matches(database)
    assert before.keys() == after.keys()
    assert all((before[k] == after[k]).all() for k in before)


def test_geometries_that_do_not_tell_are_passed_over():
    told = stored_steps([geometry(None), geometry(np.array([0, 1, 3]))], (7, 4))
    assert [pair for pair, _ in told] == [(7, 4)]
