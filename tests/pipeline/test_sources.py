"""Everything that the ingest stage reads is in what its key is made of."""

import shutil

import numpy as np
import pytest

from semsfm_colmap.config import Config
from semsfm_colmap.errors import UsageError
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.ingest.series.file import read_series
from semsfm_colmap.pipeline.merge import merge_projects
from semsfm_colmap.pipeline.record import RunRecord
from semsfm_colmap.pipeline.runner import run_stages
from semsfm_colmap.pipeline.sources import input_hashes
from tests.ingest.images import save, texture
from tests.pipeline.test_outputs import Ear

NAMES = ("a.png", "b.png", "c.png")


@pytest.fixture
def images(tmp_path):
    folder = tmp_path / "series" / "images"
    folder.mkdir(parents=True)
    for k, name in enumerate(NAMES):
        save(folder / name, texture(seed=k))
    return folder


def table(path, tilts):
    rows = "".join(f"{name},{tilt}\n" for name, tilt in zip(NAMES, tilts, strict=True))
    path.write_text("image,tilt_deg\n" + rows)
    return path


def tilts(project):
    return [f.metadata.tilt_rad for f in read_series(project / "series.json").frames]


def ingest(images, project, **options):
    config = Config(ingest=IngestOptions(**options))
    return run_stages(project, config, names=("ingest",), image_path=images)


def test_an_edited_table_is_read_again(images, tmp_path):
    csv = table(tmp_path / "angles.csv", (0, 5, 9))
    ingest(images, tmp_path / "p", series_csv=csv)
    assert np.allclose(tilts(tmp_path / "p"), np.radians([0, 5, 9]))
    table(csv, (0, 7, 9))
    ingest(images, tmp_path / "p", series_csv=csv)
    assert np.allclose(tilts(tmp_path / "p"), np.radians([0, 7, 9]))


@pytest.mark.parametrize("place", ["option", "beside", "within"])
def test_an_edited_mask_is_read_again(images, tmp_path, place):
    masks = {"beside": images.parent / "masks", "within": images / "masks"}.get(
        place, tmp_path / "mine"
    )
    options = {"masks_path": masks} if place == "option" else {}
    pixels = np.full(texture(seed=0).shape, 255, dtype=np.uint8)
    pixels[:40] = 0
    save(masks / "a.png.png", pixels)
    ingest(images, tmp_path / "p", **options)
    first = (tmp_path / "p" / "masks" / "a.png.png").read_bytes()
    pixels[:60] = 0
    save(masks / "a.png.png", pixels)
    ingest(images, tmp_path / "p", **options)
    assert (tmp_path / "p" / "masks" / "a.png.png").read_bytes() != first
    (masks / "a.png.png").unlink()
    ingest(images, tmp_path / "p", **options)
    assert not (tmp_path / "p" / "masks" / "a.png.png").exists()


def test_what_nobody_touched_is_up_to_date(images, tmp_path):
    options = {"series_csv": table(tmp_path / "angles.csv", (0, 5, 9))}
    ingest(images, tmp_path / "p", **options)
    before = (tmp_path / "p" / "series.json").stat().st_mtime_ns
    ingest(images, tmp_path / "p", **options)
    assert (tmp_path / "p" / "series.json").stat().st_mtime_ns == before


def test_images_in_a_folder_that_is_a_link_count_too(images, tmp_path):
    elsewhere = tmp_path / "elsewhere"
    shutil.move(images, elsewhere)
    images.mkdir()
    (images / "linked").symlink_to(elsewhere)
    (elsewhere / "loop").symlink_to(images)
    assert sorted(input_hashes(images, {})) == [f"linked/{name}" for name in NAMES]


@pytest.mark.parametrize("inside", ["project", "."])
def test_outputs_in_the_folder_of_the_images_are_no_inputs(images, tmp_path, inside):
    project = images / inside
    ingest(images, project)
    before = (project / "series.json").stat().st_mtime_ns
    assert sorted(ingest(images, project).inputs) == list(NAMES)
    assert (project / "series.json").stat().st_mtime_ns == before


def test_a_masks_folder_that_is_not_there_is_named(images, tmp_path):
    with pytest.raises(UsageError, match="is not a folder; give the one with the masks"):
        ingest(images, tmp_path / "p", masks_path=tmp_path / "none")


def other_images(folder, first=3):
    for k, name in enumerate(NAMES):
        save(folder / name, texture(seed=first + k))
    return folder


def test_another_series_does_not_take_the_place_of_a_project(images, tmp_path, capsys):
    other = other_images(tmp_path / "other")
    ingest(images, tmp_path / "p")
    before = {path: path.read_bytes() for path in (tmp_path / "p").rglob("*") if path.is_file()}
    with pytest.raises(UsageError) as refused:
        ingest(other, tmp_path / "p")
    assert str(refused.value) == (
        f"{tmp_path / 'p'} was made from other images, those of {images}: give another "
        "--output_path, or --force to replace all of it"
    )
    assert {path: path.read_bytes() for path in before} == before
    run_stages(tmp_path / "p", Config(), names=("ingest",), image_path=other, force=True)
    assert (tmp_path / "p" / "images" / "a.png").read_bytes() != before[
        tmp_path / "p" / "images" / "a.png"
    ]
    ingest(other, tmp_path / "p")


def test_a_series_that_was_moved_or_has_grown_goes_on_without_a_word(images, tmp_path):
    ear = Ear()
    ingest(images, tmp_path / "p")
    moved = shutil.move(images, tmp_path / "moved")
    run_stages(tmp_path / "p", Config(), names=("ingest",), image_path=moved, reporter=ear)
    save(moved / "d.png", texture(seed=9))
    run_stages(tmp_path / "p", Config(), names=("ingest",), image_path=moved, reporter=ear)
    assert not [line for line in ear.heard if "was made from" in line]


def test_images_that_are_others_in_the_same_place_are_said(images, tmp_path):
    ear = Ear()
    ingest(images, tmp_path / "p")
    other_images(images)
    run_stages(tmp_path / "p", Config(), names=("ingest",), image_path=images, reporter=ear)
    assert ear.heard[0] == (
        f"3 of 3 images that {tmp_path / 'p'} was made from are not there any more, or changed: "
        "what depends on them is made again"
    )


def test_a_merged_project_and_one_of_images_do_not_replace_one_another(images, tmp_path):
    other = other_images(tmp_path / "other")
    for name, folder in (("p", images), ("q", other)):
        ingest(folder, tmp_path / name)
    with pytest.raises(UsageError, match=r"was made from the images of .*: give another --output"):
        merge_projects([tmp_path / "p", tmp_path / "q"], ingested(images, tmp_path / "r"))
    record = RunRecord.read(tmp_path / "r" / "run.json")
    record.image_path = ""  # as a merge leaves it
    record.write()
    with pytest.raises(UsageError, match="was merged from several series: give another --output"):
        ingest(images, tmp_path / "r")


def ingested(images, project):
    ingest(images, project)
    return project
