import shutil
import sqlite3
from contextlib import closing

import numpy as np
import pytest

from semsfm_colmap.colmap.database.reader import MAX_NUM_IMAGES, read_database
from semsfm_colmap.colmap.library import pycolmap
from semsfm_colmap.errors import InputError
from tests.colmap.databases import (
    MAX_IMAGE_ID,
    Content,
    simulated_content,
    write_4x,
    write_38,
    write_311,
    write_312,
)

NAMES = ("a b.png", "sub folder/ü.tif", "日本.png")
SMALL = Content(
    names=NAMES,
    ids=(7, 2, 5),
    size=(640, 480),
    keypoints=tuple(np.arange(12.0 * (k + 2)).reshape(-1, 4) for k in range(3)),
    raw={(0, 1): np.array([[0, 1], [2, 3]]), (1, 2): np.array([[4, 0]])},
    verified={(0, 1): np.array([[2, 3], [5, 5]]), (0, 2): np.array([[1, 1]])},
)


def edit(path, *statements):
    db = sqlite3.connect(path)
    for statement in statements:
        db.execute(*statement) if isinstance(statement, tuple) else db.execute(statement)
    db.commit()
    db.close()


def read_everything(path):
    with read_database(path) as reader:
        counts = {i.image_id: len(reader.xy(i.image_id)) for i in reader.images()}
        for a, b in reader.pairs():
            reader.matches((a, b), (counts[a], counts[b]))


WRITERS = {
    "3.8": write_38,
    "3.8 in write-ahead mode": lambda path, content: write_38(path, content, wal=True),
    "an importer's": lambda path, content: write_38(path, content, version=0),
    "3.11": write_311,
    "3.12": write_312,
    "4.x with rigs": write_4x,
    "4.x without rigs": lambda path, content: write_4x(path, content, rigs=False),
}


@pytest.fixture(params=WRITERS)
def database(request, tmp_path):
    return WRITERS[request.param](tmp_path / "a database.db", SMALL)


def test_everything_comes_out_as_it_went_in(database):
    with read_database(database) as reader:
        images = {i.name: i for i in reader.images()}
        assert set(images) == set(NAMES)
        for k, name in enumerate(NAMES):
            image = images[name]
            assert image.image_id == SMALL.ids[k]
            assert (image.width_px, image.height_px) == SMALL.size
            keypoints = reader.keypoints(image.image_id)
            assert keypoints.dtype == np.float32
            assert np.array_equal(keypoints, SMALL.keypoints[k])
            assert np.array_equal(reader.xy(image.image_id), SMALL.keypoints[k][:, :2])
        counts = dict(zip(SMALL.ids, map(len, SMALL.keypoints), strict=True))
        assert reader.pairs() == [(2, 5), (2, 7), (5, 7)]
        both = reader.matches((2, 7), (counts[2], counts[7]))
        # raw ones first, then what is verified only; each once; the smaller id's keypoint first
        assert both.matches.tolist() == [[1, 0], [3, 2], [5, 5]]
        assert both.num_raw == 2
        assert reader.matches((5, 7), (counts[5], counts[7])).matches.tolist() == [[1, 1]]
        assert reader.matches((2, 5), (counts[2], counts[5])).matches.tolist() == [[4, 0]]


def test_reading_changes_nothing_and_leaves_nothing_beside(database):
    before = database.read_bytes()
    with read_database(database) as reader:
        for image in reader.images():
            reader.keypoints(image.image_id)
            reader.descriptors(image.image_id)
        reader.pairs()
    assert database.read_bytes() == before
    assert [p.name for p in database.parent.iterdir()] == [database.name]


def test_a_database_that_may_not_be_written_can_be_read(database):
    database.chmod(0o444)
    database.parent.chmod(0o555)
    try:
        with read_database(database) as reader:
            assert len(reader.images()) == 3
    finally:
        database.parent.chmod(0o755)


def test_the_pair_number_is_colmaps():
    assert MAX_NUM_IMAGES == MAX_IMAGE_ID
    for pair in ((1, 2), (3, 70000), (12345, 2147483646)):
        number = pycolmap.image_pair_to_pair_id(*pair)
        assert divmod(number, MAX_NUM_IMAGES) == pair


@pytest.mark.parametrize("columns", [2, 3, 4, 5, 6])
def test_keypoints_may_have_two_to_six_columns(tmp_path, columns):
    content, _ = simulated_content(columns=columns, num_images=3)
    with read_database(write_38(tmp_path / "d.db", content)) as reader:
        xy = reader.xy(1)
    assert np.array_equal(xy, content.keypoints[0][:, :2].astype(np.float32))


def test_an_image_without_keypoints_has_none(tmp_path):
    path = write_38(tmp_path / "d.db", SMALL)
    edit(path, "DELETE FROM keypoints WHERE image_id = 2")
    edit(path, "UPDATE keypoints SET rows = 0, data = NULL WHERE image_id = 5")
    with read_database(path) as reader:
        assert reader.xy(2).shape == (0, 2)
        assert reader.xy(5).shape == (0, 2)


def test_descriptors_come_with_the_kind_that_the_schema_knows(tmp_path):
    bytes_ = np.arange(5 * 128, dtype=np.uint8).reshape(5, 128)
    floats = np.ones((5, 64), dtype=np.float32)
    old = write_38(tmp_path / "old.db", SMALL)
    edit(
        old,
        ("INSERT INTO descriptors VALUES (7, 5, 128, ?)", (bytes_.tobytes(),)),
        ("INSERT INTO descriptors VALUES (2, 5, 64, ?)", (floats.tobytes(),)),
    )
    with read_database(old) as reader:
        kind, data = reader.descriptors(7)
        assert kind == int(pycolmap.FeatureExtractorType.SIFT)
        assert np.array_equal(data, bytes_)
        assert reader.descriptors(2) is None
        assert reader.descriptors(5) is None
    new = write_4x(tmp_path / "new.db", SMALL)
    with pycolmap.Database.open(str(new)) as db:
        kind = pycolmap.FeatureExtractorType.ALIKED_N32
        db.write_descriptors(7, pycolmap.FeatureDescriptors(kind, bytes_))
    with read_database(new) as reader:
        number, data = reader.descriptors(7)
        assert number == int(kind)
        assert np.array_equal(data, bytes_)


@pytest.mark.parametrize(
    ("damage", "sentence"),
    [
        ("UPDATE keypoints SET rows = rows + 1 WHERE image_id = 7", "take .* bytes but"),
        ("UPDATE keypoints SET cols = 1, rows = 4 * rows WHERE image_id = 7", "have 1 columns"),
        ("UPDATE matches SET cols = 1, rows = 2 * rows", "have 1 columns but 2"),
        ("UPDATE matches SET data = x'ff00000000000000' WHERE rows = 1", "name keypoint 255"),
        ("UPDATE cameras SET width = 0", "no camera with a size"),
        ("UPDATE images SET camera_id = 9", "no camera with a size"),
        ("UPDATE images SET name = '' WHERE image_id = 7", "image 7 has no name"),
    ],
)
def test_damage_is_a_sentence_with_the_place(tmp_path, damage, sentence):
    path = write_38(tmp_path / "d.db", SMALL)
    edit(path, damage)
    with pytest.raises(InputError, match=sentence) as error:
        read_everything(path)
    assert str(path) in str(error.value)


def test_another_program_may_go_on_writing(tmp_path):
    path = write_38(tmp_path / "d.db", SMALL, wal=True)
    writer = sqlite3.connect(path, isolation_level=None)
    writer.execute("DELETE FROM keypoints WHERE image_id = 2")
    writer.execute("BEGIN IMMEDIATE")
    writer.execute("DELETE FROM keypoints WHERE image_id = 5")
    with read_database(path) as reader:
        # what is committed, though it is in the log only; nothing of what is not
        assert len(reader.xy(2)) == 0
        assert len(reader.xy(5)) > 0
        writer.execute("COMMIT")
        assert len(reader.xy(5)) > 0
    writer.close()


def test_a_database_held_for_writing_is_a_sentence(tmp_path, monkeypatch):
    monkeypatch.setattr("semsfm_colmap.colmap.database.reader.LOCK_TIMEOUT_S", 0.05)
    path = write_38(tmp_path / "d.db", SMALL)
    writer = sqlite3.connect(path, isolation_level=None)
    writer.execute("BEGIN EXCLUSIVE")
    with pytest.raises(InputError, match="in use by another program"), read_database(path):
        pass
    writer.execute("ROLLBACK")
    writer.close()


def crashed(path, tmp_path):
    """The files as a program leaves them that dies in the middle of writing."""
    writer = sqlite3.connect(path, isolation_level=None)
    writer.execute("PRAGMA cache_size = 1")
    writer.execute("DELETE FROM keypoints WHERE image_id = 2")
    writer.execute("BEGIN IMMEDIATE")
    writer.execute("UPDATE keypoints SET data = zeroblob(length(data))")
    (tmp_path / "crashed").mkdir()
    for suffix in ("", "-wal", "-journal"):
        file = path.with_name(path.name + suffix)
        if file.exists():
            shutil.copy(file, tmp_path / "crashed")
    writer.execute("ROLLBACK")
    writer.close()
    return tmp_path / "crashed" / path.name


def test_what_was_committed_before_a_crash_is_read(tmp_path):
    content, _ = simulated_content(num_images=3)
    path = crashed(write_38(tmp_path / "d.db", content, wal=True), tmp_path)
    before = path.read_bytes()
    with read_database(path) as reader:
        assert len(reader.xy(2)) == 0
        assert np.array_equal(reader.xy(1), content.keypoints[0][:, :2].astype(np.float32))
    assert path.read_bytes() == before


def test_a_crash_with_a_rollback_journal_says_how_to_put_it_right(tmp_path):
    content, _ = simulated_content(num_images=3)
    path = crashed(write_38(tmp_path / "d.db", content), tmp_path)
    with pytest.raises(InputError, match="left in the middle of a transaction"):
        read_everything(path)
    with closing(sqlite3.connect(path)) as db:
        db.execute("SELECT count(*) FROM keypoints").fetchone()
    with read_database(path) as reader:
        # what was not committed is undone
        assert np.array_equal(reader.xy(1), content.keypoints[0][:, :2].astype(np.float32))
