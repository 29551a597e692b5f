"""`semsfm reconstruct --database_path`: another's features and matches in a project of ours."""

import json
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from semsfm_colmap.cli.main import main
from semsfm_colmap.colmap.database.reader import StoredImage
from semsfm_colmap.colmap.database.work import (
    read_descriptors,
    read_images,
    read_inlier_matches,
    read_keypoints,
    read_matches,
)
from semsfm_colmap.config import Config
from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.io.grey import read_grey
from semsfm_colmap.pipeline.foreign import import_database as external_import
from semsfm_colmap.pipeline.foreign.import_database import (
    crop_shift,
    hash_database,
    import_database,
    inside_only,
    reconstruct_from_database,
)
from semsfm_colmap.pipeline.project import Project, locked
from semsfm_colmap.pipeline.record import RunRecord
from semsfm_colmap.pipeline.reporter import Reporter
from semsfm_colmap.pipeline.runner import run_stages
from semsfm_colmap.records import ExtractRecord, MatchRecord
from semsfm_colmap.types import SemFrame
from tests.colmap.databases import MAX_IMAGE_ID, SCHEMA_38
from tests.ingest.stacks import write_stack


def to_38(source: Path, target: Path, *, rows_below: int = 0, prefix: str = "") -> Path:
    """A 4.x database as COLMAP 3.8 would have written it, of images `rows_below` px higher."""
    with closing(sqlite3.connect(target)) as db:
        db.executescript(SCHEMA_38)
        db.execute("ATTACH ? AS new", (str(source),))
        db.execute("INSERT INTO cameras SELECT * FROM new.cameras")
        db.execute("UPDATE cameras SET height = height + ?", (rows_below,))
        db.execute(
            "INSERT INTO images SELECT image_id, ? || name, camera_id, NULL, NULL, NULL, NULL, "
            "NULL, NULL, NULL FROM new.images",
            (prefix,),
        )
        db.execute("INSERT INTO keypoints SELECT * FROM new.keypoints")
        db.execute("INSERT INTO descriptors SELECT image_id, rows, cols, data FROM new.descriptors")
        db.execute("INSERT INTO matches SELECT * FROM new.matches")
        db.execute(
            "INSERT INTO two_view_geometries SELECT pair_id, rows, cols, data, config, F, E, H, "
            "qvec, tvec FROM new.two_view_geometries"
        )
        db.execute("PRAGMA user_version = 3800")
        db.commit()
    return target


@pytest.fixture(scope="module")
def old_database(small_project, tmp_path_factory):
    return to_38(small_project / "database.db", tmp_path_factory.mktemp("old") / "alt e.db")


@pytest.fixture(scope="module")
def ingested(small_series, tmp_path_factory):
    project = tmp_path_factory.mktemp("ingested") / "p"
    run_stages(project, Config(), names=("ingest",), image_path=small_series / "images")
    return project


def fill(project, series, database):
    """The import alone."""
    key = hash_database(database)
    with locked(Project(project)):
        import_database(
            Project(project), series / "images", database, key, Config(), Reporter(-1), force=False
        )
    return RunRecord.read(Project(project).record)


def test_a_3_8_database_arrives_whole(
    old_database, small_project, small_series, ingested, tmp_path
):
    before = old_database.read_bytes()
    project = Project(shutil.copytree(ingested, tmp_path / "p"))
    record = fill(project.path, small_series, old_database)
    assert old_database.read_bytes() == before
    assert [p.name for p in old_database.parent.iterdir()] == [old_database.name]
    ours, theirs = small_project / "database.db", project.database
    assert read_images(theirs) == read_images(ours)
    ids = [i.image_id for i in read_images(ours)]
    for image_id in ids:
        assert np.array_equal(
            read_keypoints(ours, [image_id])[image_id], read_keypoints(theirs, [image_id])[image_id]
        )
        assert np.array_equal(read_descriptors(ours, image_id), read_descriptors(theirs, image_id))
    for read in (read_matches, read_inlier_matches):
        a, b = read(ours), read(theirs)
        common = {pair for pair, rows in a.items() if len(rows)}
        assert common <= set(b)
        if read is read_matches:
            assert all(set(map(tuple, a[p])) <= set(map(tuple, b[p])) for p in common)
    assert record.entry("extract").status == record.entry("match").status == "done"
    assert len(record.result("match", MatchRecord).pairs) == 21
    assert str(old_database) in record.result("extract", ExtractRecord).notes[0]
    assert not list(project.path.glob(".*.part*"))


def test_names_and_sizes_of_the_source_images_are_understood(
    old_database, small_project, small_series, ingested, tmp_path
):
    # made from the source images: 30 rows of databar more, and one folder up
    above = to_38(
        small_project / "database.db", tmp_path / "above.db", rows_below=30, prefix="images/"
    )
    results = []
    for k, database in enumerate((old_database, above)):
        project = Project(shutil.copytree(ingested, tmp_path / f"p{k}"))
        fill(project.path, small_series, database)
        results.append(read_inlier_matches(project.database))
    assert results[0].keys() == results[1].keys()
    assert all(np.array_equal(results[0][p], results[1][p]) for p in results[0])


def test_a_database_of_the_sections_of_a_stack_is_taken(small_project, tmp_path):
    prepared = Project(small_project)
    images = [read_grey(prepared.images / name) for name in prepared.read_series().names]
    stack = write_stack(tmp_path / "tilts.st", images)
    database = shutil.copy(small_project / "database.db", tmp_path / "sections.db")
    with closing(sqlite3.connect(database)) as db:
        ids = [row[0] for row in db.execute("SELECT image_id FROM images ORDER BY image_id")]
        for number, image_id in enumerate(ids, start=1):
            name = f"tilts_{number:04d}.png"
            db.execute("UPDATE images SET name = ? WHERE image_id = ?", (name, image_id))
        db.commit()
    project = Project(tmp_path / "p")
    run_stages(project.path, Config(), names=("ingest",), image_path=stack)
    with locked(project):
        import_database(
            project, stack, database, hash_database(database), Config(), Reporter(-1), force=False
        )
    ours, theirs = (
        list(read_keypoints(path, [i.image_id for i in read_images(path)]).values())
        for path in (small_project / "database.db", project.database)
    )
    assert len(ours) == 7
    assert all(np.array_equal(a, b) for a, b in zip(ours, theirs, strict=True))
    assert len(read_inlier_matches(project.database)) > 6


def test_the_import_is_skipped_when_nothing_has_changed(
    old_database, small_series, ingested, tmp_path, monkeypatch
):
    project = Project(shutil.copytree(ingested, tmp_path / "p"))
    fill(project.path, small_series, old_database)
    ran = []
    original = external_import.copy_features
    monkeypatch.setattr(external_import, "copy_features", lambda *a: ran.append(1) or original(*a))
    fill(project.path, small_series, old_database)
    assert ran == []
    changed = to_38(project.database, tmp_path / "changed.db")
    with closing(sqlite3.connect(changed)) as db:
        db.execute("DELETE FROM matches WHERE pair_id = ?", (MAX_IMAGE_ID + 2,))
        db.commit()
    fill(project.path, small_series, changed)
    assert ran == [1]


def test_an_image_that_the_database_does_not_know_is_named(
    old_database, small_series, ingested, tmp_path
):
    project = shutil.copytree(ingested, tmp_path / "p")
    lacking = shutil.copy(old_database, tmp_path / "lacking.db")
    with closing(sqlite3.connect(lacking)) as db:
        name = db.execute("SELECT name FROM images WHERE image_id = 3").fetchone()[0]
        db.execute("UPDATE images SET name = 'other.tif' WHERE image_id = 3")
        db.commit()
    with pytest.raises(InputError, match=f"does not name {name} .of its 7 images the first is"):
        fill(project, small_series, Path(lacking))
    record = json.loads((project / "run.json").read_text())
    assert record["stages"]["extract"]["status"] != "done"
    assert not (project / "database.db").exists()


def test_images_of_another_size_are_refused(small_project, small_series, ingested, tmp_path):
    scaled = to_38(small_project / "database.db", tmp_path / "scaled.db", rows_below=7)
    project = shutil.copytree(ingested, tmp_path / "p")
    with pytest.raises(InputError, match=r"420 x 360 px \(420 x 330 without databar\), but .* 337"):
        fill(project, small_series, scaled)


def test_a_crop_shifts_keypoints_of_source_images_only(small_series):
    path = sorted((small_series / "images").iterdir())[0]
    frame = SemFrame(
        name="a.png", width_px=300, height_px=200, source_path=str(path), crop_px=(40, 50, 340, 250)
    )
    source = StoredImage(image_id=1, name="a", width_px=420, height_px=360)
    prepared = StoredImage(image_id=1, name="a", width_px=300, height_px=200)
    assert crop_shift(frame, source, Path("d.db")) == (40, 50)
    assert crop_shift(frame, prepared, Path("d.db")) == (0, 0)


def test_what_lies_outside_the_crop_keeps_its_number():
    keypoints = np.array(
        [[10.0, 10.0, 2.0], [-1.0, 5.0, 2.0], [5.0, 201.0, 2.0], [300.0, 200.0, 1]]
    )
    xy = inside_only(keypoints, (300, 200))
    assert np.array_equal(np.isfinite(xy[:, 0]), [True, False, False, True])
    assert np.array_equal(xy[0], [10.0, 10.0])


def test_a_database_that_is_none_is_refused_before_anything_is_made(small_series, tmp_path):
    with pytest.raises(InputError, match="does not exist"):
        reconstruct_from_database(small_series / "images", tmp_path / "no.db", tmp_path / "p")
    assert not (tmp_path / "p").exists()


def test_the_projects_own_database_is_not_another(small_project, small_series):
    with pytest.raises(UsageError, match="is the project's own database"):
        reconstruct_from_database(
            small_series / "images", small_project / "database.db", small_project
        )


def test_a_project_in_use_is_left_alone(old_database, small_series, ingested, tmp_path):
    project = shutil.copytree(ingested, tmp_path / "p")
    with locked(Project(project)), pytest.raises(UsageError, match="in use by another"):
        reconstruct_from_database(small_series / "images", old_database, project)
    assert not (project / "database.db").exists()


@pytest.mark.slow
def test_a_whole_reconstruction_from_another_database(old_database, small_series, tmp_path):
    project = tmp_path / "p"
    arguments = ["reconstruct", small_series / "images", "--output_path", project]
    arguments += ["--database_path", old_database, "-q"]
    assert main([*map(str, arguments)]) == 0
    for name in ("sparse/0/points3D.bin", "dense/fused.ply", "mesh/mesh.ply", "report/report.html"):
        assert (project / name).is_file()
    stages = json.loads((project / "run.json").read_text())["stages"]
    assert {s["status"] for s in stages.values()} == {"done"}
    before = {p: p.stat().st_mtime_ns for p in project.rglob("*.bin")}
    assert main([*map(str, arguments)]) == 0
    assert before == {p: p.stat().st_mtime_ns for p in project.rglob("*.bin")}
    # without the other database, features and matches are our own again
    names = ("ingest", "extract", "match")
    run_stages(project, Config(), names=names, image_path=small_series / "images")
    stages = json.loads((project / "run.json").read_text())["stages"]
    assert not stages["extract"]["summary"]["notes"]
