"""Two gigabytes of descriptors: what is not needed is not read."""

import resource
import sqlite3
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from semsfm_colmap.colmap.database.images import register_images
from semsfm_colmap.colmap.database.reader import read_database
from semsfm_colmap.colmap.database.work import write_features
from tests.colmap.databases import simulated_content, write_38

NUM_IMAGES = 32
KEYPOINTS_PER_IMAGE = 500_000
"""32 images x 500 000 descriptors x 128 bytes = 2 GB; COLMAP writes so many of a large scan with a
low peak threshold."""

READ = """
import resource, sys
from pathlib import Path
from semsfm_colmap.colmap.database.reader import read_database
with read_database(Path(sys.argv[1])) as reader:
    images = reader.images()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    keypoints = [reader.xy(i.image_id) for i in images]
    for a, b in reader.pairs():
        reader.matches((a, b), (len(keypoints[a - 1]), len(keypoints[b - 1])))
    after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
print(sum(map(len, keypoints)), (after - before) / 1024)
"""


def large_database(path: Path) -> Path:
    """The simulated body again, with many more keypoints that match nothing."""
    content, _ = simulated_content(num_images=NUM_IMAGES)
    rng = np.random.default_rng(0)
    padded = []
    for keypoints in content.keypoints:
        more = rng.uniform(0.0, 1000.0, (KEYPOINTS_PER_IMAGE - len(keypoints), 6))
        padded.append(np.concatenate([keypoints, more]).astype(np.float32))
    write_38(path, replace(content, keypoints=tuple(padded)))
    db = sqlite3.connect(path)
    for image_id in content.ids:
        db.execute(
            "INSERT INTO descriptors VALUES (?, ?, 128, zeroblob(?))",
            (image_id, KEYPOINTS_PER_IMAGE, KEYPOINTS_PER_IMAGE * 128),
        )
    db.commit()
    db.close()
    return path


@pytest.fixture
def database(tmp_path):
    yield large_database(tmp_path / "large.db")
    for path in tmp_path.iterdir():
        path.unlink()


@pytest.mark.slow
def test_two_gigabytes_of_descriptors_are_not_read_with_the_keypoints(database):
    assert database.stat().st_size > 2e9
    done = subprocess.run(
        [sys.executable, "-c", READ, str(database)], capture_output=True, text=True, check=True
    )
    count, grown_mb = done.stdout.split()
    assert int(count) == NUM_IMAGES * KEYPOINTS_PER_IMAGE
    # the places as float64 are 256 MB, one image as stored 12 MB, the matches next to nothing
    assert float(grown_mb) < 350


@pytest.mark.slow
def test_two_gigabytes_of_descriptors_are_copied_image_by_image(database, tmp_path):
    names = [f"{k}.png" for k in range(NUM_IMAGES)]
    register_images(tmp_path / "copy.db", names, [(1000, 1000)] * NUM_IMAGES)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with read_database(database) as reader:
        for image in reader.images():
            write_features(
                tmp_path / "copy.db",
                image.image_id,
                reader.keypoints(image.image_id),
                reader.descriptors(image.image_id),
            )
    grown_mb = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    assert (tmp_path / "copy.db").stat().st_size > 2e9
    # a few copies of one image's 64 + 12 MB
    assert grown_mb < 600
