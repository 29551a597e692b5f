"""Extraction while another program writes to the database."""

import sqlite3
from pathlib import Path

import cv2
import numpy as np
import pytest

from semsfm_colmap.colmap.database.checks import check_writable
from semsfm_colmap.colmap.database.scratch import scratch_database
from semsfm_colmap.colmap.database.work import (
    read_descriptors,
    read_images,
    read_keypoints,
)
from semsfm_colmap.colmap.library import pycolmap
from semsfm_colmap.colmap.options import SiftOptions
from semsfm_colmap.colmap.sift import extract_sift
from semsfm_colmap.errors import InputError

NAMES = ("a b.png", "ü/c.png", "flat.png", "small.png")
SIZES = [(240, 200), (240, 200), (240, 200), (160, 200)]


@pytest.fixture(scope="module")
def images(tmp_path_factory):
    folder = tmp_path_factory.mktemp("images")
    noise = np.random.default_rng(0).normal(size=(260, 300))
    texture = cv2.GaussianBlur(noise, (0, 0), 2.0)
    texture = np.clip(128 + 250 * texture, 0, 255).astype(np.uint8)
    flat = np.full((200, 240), 100, dtype=np.uint8)
    for name, pixels in zip(
        NAMES, (texture[:200, :240], texture[4:204, 6:246], flat, texture[:200, :160]), strict=True
    ):
        path = folder / name
        path.parent.mkdir(exist_ok=True)
        ok, data = cv2.imencode(".png", pixels)
        assert ok
        path.write_bytes(data.tobytes())
    return folder


def extract(database, images):
    extract_sift(database, images, NAMES, SIZES, SiftOptions(), num_threads=1)


@pytest.fixture(scope="module")
def filled(images, tmp_path_factory):
    database = tmp_path_factory.mktemp("filled") / "d é.db"
    extract(database, images)
    return database


def content(database):
    images = read_images(database)
    keypoints = read_keypoints(database, [i.image_id for i in images])
    return (
        images,
        [k.tobytes() for k in keypoints.values()],
        [read_descriptors(database, i.image_id).tobytes() for i in images],
    )


def test_what_is_found_is_what_pycolmap_finds_in_one_database(filled, images, tmp_path):
    database = tmp_path / "plain.db"
    extraction = pycolmap.FeatureExtractionOptions()
    extraction.use_gpu = False
    extraction.num_threads = 1
    for name in ("a b.png", "ü/c.png"):
        pycolmap.extract_features(
            str(database), str(images), image_names=[name], extraction_options=extraction,
            camera_mode=pycolmap.CameraMode.SINGLE, device=pycolmap.Device.cpu,
        )  # fmt: skip
    for image_id in (1, 2):
        assert len(read_keypoints(filled, [image_id])[image_id]) > 50
        assert np.array_equal(
            read_keypoints(filled, [image_id])[image_id],
            read_keypoints(database, [image_id])[image_id],
        )
        assert np.array_equal(
            read_descriptors(filled, image_id), read_descriptors(database, image_id)
        )


def test_an_image_without_features_is_not_searched_again(filled, images, monkeypatch):
    assert len(read_keypoints(filled, [3])[3]) == 0
    monkeypatch.setattr(pycolmap, "extract_features", None)
    before = content(filled)
    extract(filled, images)
    assert content(filled) == before


def test_nothing_is_left_beside(filled):
    assert [p.name for p in filled.parent.iterdir()] == [filled.name]


def test_what_a_killed_run_left_is_removed(tmp_path):
    database = tmp_path / "d.db"
    with scratch_database(database) as path:
        pass
    for suffix in ("", "-wal", "-shm"):
        Path(f"{path}{suffix}").write_text("half")
    with scratch_database(database) as again:
        assert again == path
        assert list(tmp_path.iterdir()) == []


def locked_during(monkeypatch, database, name):
    """Another program holds the database while pycolmap works; returns its connection."""
    other = sqlite3.connect(database, isolation_level=None, check_same_thread=False)
    original = getattr(pycolmap, name)

    def wrapped(*args, **kwargs):
        other.execute("BEGIN IMMEDIATE")
        return original(*args, **kwargs)

    monkeypatch.setattr(pycolmap, name, wrapped)
    monkeypatch.setitem(check_writable.__kwdefaults__, "timeout_s", 0.05)
    return other


def test_a_lock_that_comes_while_pycolmap_works_is_a_sentence(
    filled, images, tmp_path, monkeypatch
):
    database = tmp_path / "d.db"
    extract(database, images)
    with pycolmap.Database.open(str(database)) as db:
        db.clear_descriptors()
        db.clear_keypoints()
    with monkeypatch.context() as patch:
        other = locked_during(patch, database, "extract_features")
        with pytest.raises(InputError, match="in use by another program"):
            extract(database, images)
        other.execute("ROLLBACK")
        other.close()
    assert [p.name for p in tmp_path.iterdir()] == [database.name]
    # and the next run goes on
    extract(database, images)
    assert content(database) == content(filled)
