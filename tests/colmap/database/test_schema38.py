import shutil
import sqlite3
import subprocess
from contextlib import closing

import numpy as np
import pytest

from semsfm_colmap.colmap.database.reader import read_database
from semsfm_colmap.colmap.database.schema38 import write_database_38
from semsfm_colmap.colmap.library import pycolmap
from semsfm_colmap.errors import InputError, UsageError
from tests.colmap.databases import SCHEMA_38, simulated_content, write_4x, write_38


@pytest.fixture
def database(tmp_path):
    content, _ = simulated_content(num_images=4)
    path = write_4x(tmp_path / "new é.db", content)
    with pycolmap.Database.open(str(path)) as db:
        for image_id, kind in zip(content.ids, ("SIFT", "SIFT", "SIFT", "ALIKED_N32"), strict=True):
            data = np.full((len(content.keypoints[image_id - 1]), 128), image_id, dtype=np.uint8)
            kind = getattr(pycolmap.FeatureExtractorType, kind)
            db.write_descriptors(image_id, pycolmap.FeatureDescriptors(kind, data))
    return path


def everything(path):
    with read_database(path) as reader:
        images = reader.images()
        keypoints = {i.image_id: reader.keypoints(i.image_id) for i in images}
        pairs = reader.pairs()
        matches = [
            reader.matches((a, b), (len(keypoints[a]), len(keypoints[b]))).matches for a, b in pairs
        ]
    return images, [k.tobytes() for k in keypoints.values()], pairs, [m.tobytes() for m in matches]


def schema(path):
    with closing(sqlite3.connect(path)) as db:
        return {
            name: [tuple(c[1:4]) for c in db.execute(f"PRAGMA table_info({name})")]
            for (name,) in db.execute("SELECT name FROM sqlite_master WHERE type = 'table'")
        }


def test_a_4x_database_becomes_one_of_3_8(database, tmp_path):
    before = database.read_bytes()
    write_database_38(database, tmp_path / "old.db")
    assert database.read_bytes() == before
    assert {p.name for p in tmp_path.iterdir()} == {database.name, "old.db"}
    assert everything(tmp_path / "old.db") == everything(database)
    with closing(sqlite3.connect(tmp_path / "plain.db")) as db:
        db.executescript(SCHEMA_38)
    assert schema(tmp_path / "old.db") == schema(tmp_path / "plain.db")
    with read_database(tmp_path / "old.db") as reader:
        assert np.all(reader.descriptors(2)[1] == 2)
        # not SIFT, which 3.8 would take it for
        assert reader.descriptors(4) is None


def test_3_8_to_4x_and_back_is_what_it_was(tmp_path):
    content, _ = simulated_content(num_images=4)
    old = write_38(tmp_path / "old.db", content)
    shutil.copy(old, tmp_path / "migrated.db")
    with pycolmap.Database.open(str(tmp_path / "migrated.db")) as db:
        assert db.num_images() == 4
    write_database_38(tmp_path / "migrated.db", tmp_path / "back.db")
    assert everything(tmp_path / "back.db") == everything(old)
    assert schema(tmp_path / "back.db") == schema(old)


@pytest.mark.skipif(shutil.which("colmap") is None, reason="COLMAP's program is not installed")
def test_colmaps_program_opens_it(database, tmp_path):
    write_database_38(database, tmp_path / "old.db")
    (tmp_path / "models").mkdir()
    command = ["colmap", "exhaustive_matcher", "--database_path", str(tmp_path / "old.db")]
    command += ["--SiftMatching.use_gpu", "0"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    # a newer COLMAP opens it as well
    assert done.returncode == 0, done.stdout + done.stderr


def test_nothing_is_overwritten_and_nothing_is_left(database, tmp_path):
    (tmp_path / "there.db").touch()
    with pytest.raises(UsageError, match="exists: give another name"):
        write_database_38(database, tmp_path / "there.db")
    with closing(sqlite3.connect(database)) as db:
        db.execute("UPDATE cameras SET model = 14")
        db.commit()
    with pytest.raises(InputError, match=r"3\.8 does not know the model of camera 1"):
        write_database_38(database, tmp_path / "old.db")
    assert {p.name for p in tmp_path.iterdir()} == {database.name, "there.db"}
