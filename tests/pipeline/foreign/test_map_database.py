"""`semsfm map --database_path`: databases as COLMAP, pycolmap and importers fill them."""

import json
import shutil
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import cv2
import numpy as np
import pytest

from semsfm_colmap.cli.main import main
from semsfm_colmap.colmap.database.reader import read_database
from semsfm_colmap.colmap.database.work import read_inlier_matches
from semsfm_colmap.colmap.library import pycolmap
from semsfm_colmap.colmap.model.sparse import read_model
from semsfm_colmap.colmap.presets import pipeline_options
from semsfm_colmap.config import Config
from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.pipeline.executor import ThreadExecutor
from semsfm_colmap.pipeline.foreign.map_database import (
    in_acquisition_order,
    map_database,
    verify_database,
)
from semsfm_colmap.pipeline.project import MODELS_LOCK_FILE, Project, check_output, locked_folder
from semsfm_colmap.pipeline.reporter import Reporter
from tests.alignment import best_hand_errors_deg
from tests.colmap.databases import simulated_content, write_4x, write_38

UNORDERED = tuple(f"dir {k % 2}/bild ü {k}.png" for k in (2, 10, 4, 1, 8, 3, 11, 9))


def errors_deg(model, content, tracks):
    """Rotation errors with the images of the model taken from the simulation by name."""
    numbers = [content.names.index(name) for name in model.image_names]
    return best_hand_errors_deg(
        model.cameras.cam_from_world, np.asarray(tracks.cameras.cam_from_world)[numbers]
    )


def bytes_of(folder):
    return {p.name: p.read_bytes() for p in folder.iterdir() if p.is_file()}


CASES = {
    "3.8, raw only, two columns": (write_38, {"columns": 2, "verified": False}),
    "3.8, raw and perspective": (write_38, {}),
    "importer, verified only": (
        lambda p, c: write_38(p, c, version=0),
        {"columns": 2, "raw": False},
    ),
    "4.x with rigs": (write_4x, {}),
    "4.x without rigs, raw only": (
        lambda p, c: write_4x(p, c, rigs=False),
        {"verified": False, "columns": 4},
    ),
    "4.x, a camera an image": (lambda p, c: write_4x(p, c, cameras=8), {}),
    "4.x, a camera an image, no rigs": (lambda p, c: write_4x(p, c, cameras=8, rigs=False), {}),
    "4.x, rigs of two cameras": (lambda p, c: write_4x(p, c, cameras=2, together=2), {}),
    "ids without order": (write_38, {"ids": (5, 9, 2, 700, 3, 11, 12, 4), "names": UNORDERED}),
}


@pytest.mark.parametrize("case", CASES)
def test_any_database_gives_the_cameras_back(case, tmp_path):
    write, options = CASES[case]
    content, tracks = simulated_content(**options)
    (tmp_path / "in").mkdir()
    database = write(tmp_path / "in" / "d.db", content)
    before = bytes_of(tmp_path / "in")
    mapped = map_database(database, tmp_path / "out")
    assert bytes_of(tmp_path / "in") == before
    model = read_model(tmp_path / "out" / "0")
    assert model.num_images == mapped.num_images == 8
    errors = errors_deg(model, content, tracks)
    # 0.2 px of noise on some 150 points an image: some hundredths of a degree, but never none
    assert 1e-4 < np.median(errors) < 0.05
    assert mapped.rms_px == pytest.approx(0.2, rel=0.25)
    # the model's ids are those of the database, so that COLMAP can go on with both
    ids = {
        i.name: i.image_id for i in pycolmap.Reconstruction(str(tmp_path / "out/0")).images.values()
    }
    assert ids == dict(zip(content.names, content.ids, strict=True))


def test_images_are_taken_in_natural_order_of_their_names(tmp_path):
    content, _ = simulated_content(names=UNORDERED, ids=(5, 9, 2, 700, 3, 11, 12, 4))
    map_database(write_38(tmp_path / "d.db", content), tmp_path / "out")
    model = read_model(tmp_path / "out" / "0")
    assert [n.rsplit(" ", 1)[-1] for n in model.image_names] == [
        *("2.png", "4.png", "8.png", "10.png"),
        *("1.png", "3.png", "9.png", "11.png"),
    ]


def test_perspective_verdicts_are_not_believed(tmp_path):
    # all matches called verified, a third of them wrong
    content, tracks = simulated_content(raw=False, wrong_share=0.33)
    map_database(write_38(tmp_path / "d.db", content), tmp_path / "out")
    model = read_model(tmp_path / "out" / "0")
    assert model.num_images == 8
    assert np.median(errors_deg(model, content, tracks)) < 0.05


def test_a_pair_is_verified_the_same_whether_raw_or_perspective(tmp_path):
    results = []
    for k, options in enumerate(({"verified": False}, {"raw": False}, {})):
        content, _ = simulated_content(**options)
        map_database(write_38(tmp_path / f"{k}.db", content), tmp_path / f"{k}")
        results.append((tmp_path / f"{k}" / "0" / "points3D.bin").read_bytes())
    assert results[0] == results[1] == results[2]


def test_keypoints_that_are_not_finite_are_left_out(tmp_path):
    content, tracks = simulated_content()
    content.keypoints[3][:20] = np.nan
    map_database(write_38(tmp_path / "d.db", content), tmp_path / "out")
    model = read_model(tmp_path / "out" / "0")
    assert model.num_images == 8
    assert np.all(np.isfinite(model.points))
    assert np.median(errors_deg(model, content, tracks)) < 0.05


def test_flags_give_micrometres_and_tilt(tmp_path):
    content, _ = simulated_content()
    database = write_38(tmp_path / "d.db", content)
    table = tmp_path / "tilts.csv"
    step = 70.0 / 7.0
    lines = [f"{n},{step * k}" for k, n in enumerate(content.names)]
    table.write_text("\n".join(["image,tilt_deg", *lines]) + "\n", encoding="utf-8")
    arguments = ["--database_path", database, "--output_path", tmp_path / "out", "-q"]
    arguments += ["--pixel_size_um", 0.05, "--series_csv", table]
    assert main(["map", *map(str, arguments)]) == 0
    model = read_model(tmp_path / "out" / "0")
    assert model.world_unit == "um"
    assert model.pixel_size_um == 0.05
    assert np.allclose(model.cameras.scale_px_per_unit, 20.0, rtol=0.01)


def images_of(content, folder, size=(1000, 1000)):
    for k, name in enumerate(content.names):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        ok, data = cv2.imencode(".png", np.full((size[1], size[0]), 40 + k, dtype=np.uint8))
        assert ok
        path.write_bytes(data.tobytes())
    return folder


def test_points_take_their_grey_from_the_images(tmp_path):
    content, _ = simulated_content()
    database = write_38(tmp_path / "d.db", content)
    images = images_of(content, tmp_path / "images")
    map_database(database, tmp_path / "out", image_path=images)
    color = read_model(tmp_path / "out" / "0").point_color
    assert 40 <= color.min() <= color.max() < 48
    map_database(database, tmp_path / "grey")
    assert np.all(read_model(tmp_path / "grey" / "0").point_color == 128)


def test_images_that_are_not_those_of_the_database_are_a_sentence(tmp_path):
    content, _ = simulated_content()
    database = write_38(tmp_path / "d.db", content)
    with pytest.raises(UsageError, match="not a folder"):
        map_database(database, tmp_path / "out", image_path=tmp_path / "none")
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match=r"bild ü 1.png does not exist, but .* names it"):
        map_database(database, tmp_path / "out", image_path=tmp_path / "empty")
    images = images_of(content, tmp_path / "small", size=(500, 500))
    with pytest.raises(InputError, match=r"is 500 x 500 px, but .* 1000 x 1000 px"):
        map_database(database, tmp_path / "out", image_path=images)
    assert not (tmp_path / "out").exists()


def test_a_database_without_matches_or_keypoints_says_what_to_run(tmp_path):
    content, _ = simulated_content(raw=False, verified=False, num_images=3)
    with pytest.raises(InputError, match="keypoints but no matches"):
        map_database(write_38(tmp_path / "a.db", content), tmp_path / "out")
    path = tmp_path / "b.db"
    with pycolmap.Database.open(str(path)):
        pass
    with pytest.raises(InputError, match="holds 0 images: three are needed"):
        map_database(path, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_another_programs_models_are_not_overwritten(tmp_path):
    content, _ = simulated_content()
    database = write_38(tmp_path / "d.db", content)
    (tmp_path / "out" / "0").mkdir(parents=True)
    (tmp_path / "out" / "0" / "cameras.bin").write_text("COLMAP's")
    with pytest.raises(UsageError, match="was not made by semsfm"):
        map_database(database, tmp_path / "out")
    shutil.rmtree(tmp_path / "out" / "0")
    # those with higher numbers stay as well, ours are replaced
    (tmp_path / "out" / "7").mkdir()
    map_database(database, tmp_path / "out")
    shutil.copytree(tmp_path / "out" / "0", tmp_path / "out" / "3")
    map_database(database, tmp_path / "out")
    assert {p.name for p in (tmp_path / "out").iterdir()} >= {"0", "7"}
    assert not (tmp_path / "out" / "3").exists()


def test_a_projects_models_are_left_to_the_project(tmp_path):
    content, _ = simulated_content(num_images=3)
    database = write_38(tmp_path / "d.db", content)
    (tmp_path / "run.json").write_text("{}")
    with pytest.raises(UsageError, match=r"belongs to the project .*: run `semsfm map"):
        map_database(database, tmp_path / "sparse")


def test_two_processes_on_one_folder_are_told_apart(tmp_path):
    content, _ = simulated_content()
    database = write_38(tmp_path / "d.db", content)
    with (
        locked_folder(tmp_path / "out", MODELS_LOCK_FILE),
        pytest.raises(UsageError, match="in use by another"),
    ):
        map_database(database, tmp_path / "out")
    map_database(database, tmp_path / "out")
    assert (tmp_path / "out" / MODELS_LOCK_FILE).exists()
    # which does not make a project of it
    (tmp_path / "out" / "database.db").touch()
    with pytest.raises(UsageError, match="was not made by semsfm"):
        check_output(Project(tmp_path / "out"), ["database.db"])


def test_a_lock_can_be_held_by_one_only_whoever_comes_when(tmp_path):
    code = (
        "import sys, time, pathlib\n"
        "from semsfm_colmap.pipeline.project import locked_folder\n"
        "from semsfm_colmap.errors import UsageError\n"
        "folder = pathlib.Path(sys.argv[1]); end = time.monotonic() + 2.0; held = 0\n"
        "while time.monotonic() < end:\n"
        "    try:\n"
        "        with locked_folder(folder, '.lock'):\n"
        "            (folder / 'held').mkdir()\n"  # fails when somebody else holds it too
        "            held += 1\n"
        "            (folder / 'held').rmdir()\n"
        "    except UsageError:\n"
        "        pass\n"
        "assert held\n"
    )
    folder = tmp_path / "p"
    folder.mkdir()
    (folder / "something").touch()
    processes = [
        subprocess.Popen([sys.executable, "-c", code, str(folder)], stderr=subprocess.PIPE)
        for _ in range(3)
    ]
    for process in processes:
        _, err = process.communicate(timeout=60)
        assert process.returncode == 0, err.decode()


def test_the_command_line_says_one_sentence(tmp_path, capsys):
    content, _ = simulated_content(num_images=3)
    database = write_38(tmp_path / "d.db", content)
    database.write_text("no database")
    flags = ["--database_path", str(database), "--output_path", str(tmp_path / "out")]
    assert main(["map", *flags]) == 1
    out, err = capsys.readouterr()
    assert out == ""
    assert err == f"semsfm map: {database} is not a COLMAP database: it is no SQLite file\n"


@pytest.mark.skipif(shutil.which("colmap") is None, reason="COLMAP's program is not installed")
def test_colmap_3_8_goes_on_with_its_database_and_our_model(tmp_path):
    content, _ = simulated_content(wrong_share=0.0)
    database = write_38(tmp_path / "d.db", content)
    map_database(database, tmp_path / "out")
    images = images_of(content, tmp_path / "images")
    (tmp_path / "triangulated").mkdir()
    command = ["colmap", "point_triangulator", "--database_path", database]
    command += ["--image_path", images, "--input_path", tmp_path / "out" / "0"]
    command += ["--output_path", tmp_path / "triangulated", "--clear_points", "1"]
    # what a long focal length needs
    command += ["--Mapper.max_focal_length_ratio", "1e9", "--Mapper.ba_refine_focal_length", "0"]
    done = subprocess.run([*map(str, command)], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stdout + done.stderr
    ours = read_model(tmp_path / "out" / "0")
    theirs = pycolmap.Reconstruction(str(tmp_path / "triangulated"))
    assert theirs.num_reg_images() == 8
    assert theirs.num_points3D() > 0.9 * len(ours.points)
    assert theirs.compute_mean_reprojection_error() < 0.4


def test_a_projects_own_matches_are_verified_as_the_project_did(small_project, tmp_path):
    database = small_project / "database.db"
    stages = json.loads((small_project / "run.json").read_text())["stages"]
    # keypoints after these were put there by the mapping, which starts from the others
    counts = list(stages["extract"]["summary"]["num_keypoints"].values())
    stored = {
        (a, b): rows[(rows[:, 0] < counts[a - 1]) & (rows[:, 1] < counts[b - 1])]
        for (a, b), rows in read_inlier_matches(database).items()
    }
    database = Path(shutil.copy(database, tmp_path / "raw.db"))
    with closing(sqlite3.connect(database)) as db:
        db.execute("DELETE FROM two_view_geometries")
        db.commit()
    with read_database(database) as reader:
        images = in_acquisition_order(reader.images())
        ids = [image.image_id for image in images]
        assert ids == sorted(ids)
        keypoints = [reader.xy(image_id) for image_id in ids]
        found = {
            (ids[g.image_pair[0]], ids[g.image_pair[1]]): g.keypoints[g.inlier]
            for g in verify_database(
                reader, ids, keypoints, Config(), Reporter(-1), ThreadExecutor(2)
            )
            if g.F is not None
        }
    assert found.keys() == {pair for pair, rows in stored.items() if len(rows)}
    assert len(found) > 6
    assert all(np.array_equal(found[pair], stored[pair]) for pair in found)


@pytest.mark.parametrize(
    "case",
    ["4.x with rigs", "4.x, a camera an image", "4.x, rigs of two cameras", "ids without order"],
)
def test_pycolmap_goes_on_with_the_model_and_the_database_beside_it(case, tmp_path):
    write, options = CASES[case]
    content, _ = simulated_content(wrong_share=0.0, **options)
    database = write(tmp_path / "d.db", content)
    map_database(database, tmp_path / "out")
    path = tmp_path / "out" / "0"
    (tmp_path / "triangulated").mkdir()
    theirs = pycolmap.triangulate_points(
        pycolmap.Reconstruction(str(path)), str(path / "database.db"), str(tmp_path),
        str(tmp_path / "triangulated"), clear_points=True, options=pipeline_options(),
    )  # fmt: skip
    ours = read_model(path)
    assert theirs.num_reg_images() == 8
    assert theirs.num_points3D() > 0.9 * len(ours.points)
    assert theirs.compute_mean_reprojection_error() < 0.4


def test_the_database_beside_the_model_holds_the_verified_matches_by_its_ids(tmp_path):
    write, options = CASES["ids without order"]
    content, _ = simulated_content(**options)
    map_database(write(tmp_path / "d.db", content), tmp_path / "out")
    path = tmp_path / "out" / "0" / "database.db"
    given = content.stored(content.raw)
    xy = dict(zip(content.ids, content.keypoints, strict=True))
    found = read_inlier_matches(path)
    assert sum(map(len, found.values())) > 0.8 * sum(map(len, given.values()))
    with pycolmap.Database.open(str(path)) as db:
        for (a, b), rows in found.items():
            assert set(map(tuple, rows)) <= set(map(tuple, given[a, b]))
            F = db.read_two_view_geometry(a, b).F
            first, second = (
                np.column_stack([xy[i][k, :2], np.ones(len(k))]) for i, k in ((a, rows[:, 0]),
                                                                              (b, rows[:, 1]))
            )  # fmt: skip
            line = first @ F.T
            distance = np.abs(np.sum(second * line, axis=1)) / np.linalg.norm(line[:, :2], axis=1)
            assert np.median(distance) < 1.0
