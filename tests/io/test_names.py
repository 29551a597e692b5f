"""A name out of a file stays below its folder."""

import json
import os
import sqlite3

import pytest

from semsfm_colmap.colmap.database.images import register_images
from semsfm_colmap.colmap.database.reader import read_database
from semsfm_colmap.colmap.database.work import read_images
from semsfm_colmap.colmap.model.sidecar import read_sidecar
from semsfm_colmap.errors import InputError
from semsfm_colmap.ingest.series.file import read_series, read_written_files, write_series
from semsfm_colmap.io.atomic import aside_path, file_aside, folder_aside, write_text
from semsfm_colmap.io.names import leaves_folder, same_images
from semsfm_colmap.types import SemFrame, SemSeries

OUTSIDE = (
    "../a.png", "a/../../b.png", "..", ".", "", "/etc/a.png", "\\a.png", "..\\a.png",
    "a\\..\\b.png", "C:\\a.png", "c:/a.png", "\\\\server\\a.png", "a\0.png", "//a.png",
)  # fmt: skip
INSIDE = (
    "a.png",
    "left/a.png",
    "..a.png",
    "a..b.png",
    "a...png",
    "a:1.png",
    "...",
    "ü é.tif",
    "-x",
)


@pytest.mark.parametrize("name", OUTSIDE)
def test_a_name_that_leaves_its_folder_is_told(name):
    assert leaves_folder(name)


@pytest.mark.parametrize("name", INSIDE)
def test_any_other_name_is_kept(name):
    assert not leaves_folder(name)


@pytest.mark.parametrize("name", OUTSIDE)
def test_a_series_with_such_a_name_is_refused_and_nothing_of_it_removed(tmp_path, name):
    frame = SemFrame(name=name, width_px=9, height_px=9, source_path="", crop_px=(0, 0, 9, 9))
    path = tmp_path / "series.json"
    write_series(SemSeries(frames=(frame,)), path)
    with pytest.raises(InputError, match=r"series\.json names the image"):
        read_series(path)
    assert read_written_files(path).images == set()


@pytest.mark.parametrize("name", [n for n in OUTSIDE if n and "\0" not in n])
def test_a_database_with_such_a_name_is_refused(tmp_path, name):
    path = tmp_path / "database.db"
    register_images(path, ["a.png"], [(9, 9)])
    with sqlite3.connect(path) as connection:
        connection.execute("UPDATE images SET name = ? WHERE image_id = 1", (name,))
    connection.close()
    with pytest.raises(InputError, match="names the image"), read_database(path) as reader:
        reader.images()
    with pytest.raises(InputError, match="names the image"):
        read_images(path)


def sidecar() -> dict:
    entry = {"cam_from_world": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "scale_px_per_unit": 2.0,
             "translation_px": [0, 0]}  # fmt: skip
    return {
        "format": "semsfm-orthographic", "version": 1, "world_unit": "um", "pixel_size": None,
        "depth_sign": {"status": "ambiguous", "confidence": 0.5, "evidence": {}},
        "camera_model": "orthographic", "aspect": 1.0, "skew": 0.0, "gauge": "",
        "telecentric": {"focal_length_px": 1e6, "max_deviation_px": 0.01}, "images": {"a": entry},
    }  # fmt: skip


@pytest.mark.parametrize("name", OUTSIDE)
def test_a_sidecar_with_such_a_name_is_refused(tmp_path, name):
    data = sidecar()
    data["images"] = {name: data["images"]["a"]}
    (tmp_path / "orthographic.json").write_text(json.dumps(data))
    with pytest.raises(InputError, match=r"orthographic\.json names the image"):
        read_sidecar(tmp_path / "orthographic.json")


@pytest.mark.parametrize("key", [*sidecar(), "cam_from_world", "translation_px"])
@pytest.mark.parametrize("value", [None, "absent", "nan"])
def test_a_damaged_sidecar_is_refused_in_a_sentence(tmp_path, key, value):
    data = sidecar()
    place = data if key in data else data["images"]["a"]
    if value == "absent":
        del place[key]
    else:
        place[key] = None if value is None else [float("nan")]
    path = tmp_path / "orthographic.json"
    path.write_text(json.dumps(data))
    harmless = key == "pixel_size" or key in ("world_unit", "camera_model", "gauge")
    if harmless and value != "absent":
        return
    with pytest.raises(InputError, match=r"orthographic\.json.*semsfm map"):
        read_sidecar(path)


def test_a_link_planted_under_the_name_of_what_is_written_aside_is_not_followed(tmp_path):
    victim, path = tmp_path / "victim", tmp_path / "run.json"
    victim.write_text("precious")
    os.symlink(victim, aside_path(path))
    write_text("new", path)
    assert (victim.read_text(), path.read_text()) == ("precious", "new")
    assert not path.is_symlink()
    os.symlink(tmp_path / "not there yet", aside_path(path))
    with file_aside(path) as aside:
        aside.write_text("newer")
    assert not (tmp_path / "not there yet").exists()
    assert path.read_text() == "newer"


def test_a_link_planted_under_the_name_of_a_folder_aside_is_not_followed(tmp_path):
    victim, path = tmp_path / "victim", tmp_path / "maps"
    victim.mkdir()
    (victim / "precious").touch()
    for suffix in (".part", ".old"):
        os.symlink(victim, aside_path(path, suffix))
    path.mkdir()
    with folder_aside(path) as aside:
        (aside / "new").touch()
    assert (victim / "precious").exists()
    assert [p.name for p in path.iterdir()] == ["new"]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["maps", "victim"]


@pytest.mark.parametrize(
    ("there", "same"),
    [
        (["b.tif", "a.tif"], {"a.tif": "x/a.png", "b.tif": "x/b.png"}),
        (["x/b.png", "x/a.png"], {"x/a.png": "x/a.png", "x/b.png": "x/b.png"}),
        (["y/a.png", "x/a.jpg", "x/b.jpg"], {"x/a.jpg": "x/a.png", "x/b.jpg": "x/b.png"}),
        (["y/a.png", "z/a.png", "z/b.png"], {}),
        (["x/a.png", "c.png"], {"x/a.png": "x/a.png"}),
    ],
    ids=["folder and suffix", "the same", "suffix before folder", "two of one name", "one missing"],
)
def test_names_of_one_image_in_two_programs_are_matched_all_or_none(there, same):
    assert same_images(["x/a.png", "x/b.png"], there) == same


def test_names_that_only_folders_tell_apart_are_not_matched_by_the_file():
    assert same_images(["x/a.png", "y/a.png"], ["a.png", "x/a.png"]) == {"x/a.png": "x/a.png"}
