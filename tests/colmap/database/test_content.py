"""A part of a database is known by what its own stage has written, and by nothing else."""

import shutil
import sqlite3
from contextlib import closing

import numpy as np
import pytest

from semsfm_colmap.colmap.database.content import PARTS, content_key, is_sound
from semsfm_colmap.colmap.database.images import register_images
from semsfm_colmap.colmap.database.match_steps import write_match_steps
from semsfm_colmap.colmap.database.measured import write_num_measured
from semsfm_colmap.colmap.database.work import (
    read_images,
    replace_appended_keypoints,
    write_features,
    write_matches,
    write_two_view_geometries,
)

F = np.array([[0, 0, 1.0], [0, 0, 2.0], [3.0, 4.0, 5.0]])


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Three images with five keypoints each, all pairs matched, one of them verified."""
    path = tmp_path_factory.mktemp("content") / "database.db"
    rng = np.random.default_rng(0)
    register_images(path, ["a.png", "b.png", "c.png"], [(64, 48)] * 3)
    for image_id in (1, 2, 3):
        descriptors = rng.integers(0, 255, (5, 128), dtype=np.uint8)
        write_features(path, image_id, rng.uniform(0, 40, (5, 4)), (0, descriptors))
    rows = np.array([[0, 1], [2, 2], [4, 3]])
    write_matches(path, {(1, 2): rows, (1, 3): rows, (2, 3): rows[:1]})
    write_two_view_geometries(path, {(1, 2): (F, rows[:2]), (1, 3): (None, rows[:0])})
    write_match_steps(path, [((1, 2), np.array([3, 3, 1]))])
    return path


@pytest.fixture
def path(made, tmp_path):
    return shutil.copy(made, tmp_path / "database.db")


def keys(path):
    return {part: content_key(path, part) for part in PARTS}


def guide(path):
    """What a guided pass does: keypoints behind the measured ones, and their matches."""
    write_num_measured(path, {1: 5, 2: 5, 3: 5})
    replace_appended_keypoints(
        path,
        {1: (5, np.ones((2, 2))), 2: (5, np.ones((1, 2))), 3: (5, np.ones((2, 2)))},
        {(1, 2): (2 * F, np.array([[5, 5]])), (1, 3): (F, np.array([[6, 6]]))},
    )


def test_reading_with_pycolmap_and_vacuuming_change_nothing(path):
    before = keys(path)
    assert all(before.values())
    read_images(path)
    with closing(sqlite3.connect(path)) as db:
        db.execute("VACUUM")
    assert keys(path) == before


def test_a_guided_pass_leaves_what_was_measured_and_matched(path):
    before = keys(path)
    guide(path)
    after = keys(path)
    assert [part for part in PARTS if after[part] != before[part]] == ["guided"]


@pytest.mark.parametrize(
    ("statement", "parts"),
    [
        ("UPDATE images SET name = 'z.png' WHERE image_id = 2", {"features"}),
        ("DELETE FROM descriptors WHERE image_id = 3", {"features"}),
        ("UPDATE keypoints SET data = zeroblob(80) WHERE image_id = 1", {"features", "guided"}),
        ("DELETE FROM matches WHERE rows = 1", {"matches"}),
        ("DELETE FROM semsfm_match_steps", {"matches"}),
        ("UPDATE two_view_geometries SET F = NULL WHERE config > 1", {"guided"}),
        ("DELETE FROM two_view_geometries", {"matches", "guided"}),
    ],
)
@pytest.mark.parametrize("guided", [False, True])
def test_a_change_shows_in_the_parts_that_it_is_of(path, statement, parts, guided):
    if guided:
        guide(path)
    before = keys(path)
    with closing(sqlite3.connect(path)) as db, db:
        db.execute(statement)
    after = keys(path)
    assert {part for part in PARTS if after[part] != before[part]} == parts


@pytest.mark.parametrize("damage", ["missing", "empty", "cut", "overwritten", "another's"])
def test_a_damaged_file_holds_nothing(path, damage):
    content = path.read_bytes()
    if damage == "missing":
        path.unlink()
    elif damage == "another's":
        path.unlink()
        with closing(sqlite3.connect(path)) as db, db:
            db.execute("CREATE TABLE mine (a)")
        assert is_sound(path)
    else:
        half = len(content) // 2
        rest = {"empty": b"", "cut": content[:half], "overwritten": b"\xff" * len(content)}
        path.write_bytes(rest[damage])
        assert not is_sound(path)
    assert set(keys(path).values()) == {None}
