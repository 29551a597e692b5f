"""Several projects become one."""

import json
import shutil
from dataclasses import replace

import cv2
import numpy as np
import pytest

from semsfm_colmap.cli.main import main
from semsfm_colmap.colmap.model.sparse import read_model
from semsfm_colmap.config import config_from_dict
from semsfm_colmap.errors import InputError
from semsfm_colmap.geometry.rotations import rotation_angle, rotation_from_vector
from semsfm_colmap.pipeline.merge import check_crossing, merge_projects, series_labels
from semsfm_colmap.pipeline.project import Project
from semsfm_colmap.pipeline.record import RunRecord, StageEntry
from semsfm_colmap.pipeline.runner import run_stages
from semsfm_colmap.records import MatchRecord, PairStatistics
from semsfm_colmap.synthetic.series import synthesize
from semsfm_colmap.types import SemFrame, SemSeries
from tests.conftest import SMALL

ZOOM = 1.5
QUICK = config_from_dict({"guided": {"enabled": False}})


@pytest.fixture(scope="module")
def mounted_anew(small_project, tmp_path_factory):
    """The small project with its images turned by a quarter and enlarged."""
    path = tmp_path_factory.mktemp("anew") / "anew"
    shutil.copytree(small_project, path)
    content = json.loads((path / "series.json").read_text())
    for frame in content["frames"]:
        file = str(path / "images" / frame["name"])
        turned = cv2.rotate(cv2.imread(file, cv2.IMREAD_GRAYSCALE), cv2.ROTATE_90_CLOCKWISE)
        larger = cv2.resize(turned, None, fx=ZOOM, fy=ZOOM, interpolation=cv2.INTER_CUBIC)
        cv2.imwrite(file, larger)
        frame["height_px"], frame["width_px"] = larger.shape
    content["pixel_size_um"] /= ZOOM
    (path / "series.json").write_text(json.dumps(content))
    return path


@pytest.fixture(scope="module")
def merged(small_project, mounted_anew, tmp_path_factory):
    path = tmp_path_factory.mktemp("merged") / "m"
    merge_projects([small_project, mounted_anew], path, QUICK)
    return path


def test_a_quarter_turn_and_a_magnification_come_out_in_one_model(merged):
    model = read_model(merged / "sparse" / "0")
    assert model.num_images == 14
    label = np.array([name.split("_")[0] for name in model.image_names])
    R, scale = model.cameras.cam_from_world, np.log(model.cameras.scale_px_per_unit)
    ratio = np.exp(scale[label == "anew"].mean() - scale[label == "p"].mean())
    assert ratio == pytest.approx(ZOOM, rel=1e-3)
    # clockwise with y down is a positive turn about z
    quarter = rotation_from_vector(np.array([0.0, 0.0, np.pi / 2]))
    between = R[label == "anew"] @ np.swapaxes(R[label == "p"], 1, 2)
    assert np.rad2deg(rotation_angle(between @ quarter.T)).max() < 0.1
    assert model.world_unit == "um"


def test_the_folder_is_an_ordinary_project(merged, small_project):
    project = Project(merged)
    series = project.read_series()
    assert series.series_names == ("p", "anew")
    assert series.names[0] == f"p_{Project(small_project).read_series().names[0]}"
    assert all((project.images / name).is_file() for name in series.names)
    sizes = series.series_pixel_sizes_um
    assert series.pixel_size_um == sizes[0] == pytest.approx(ZOOM * sizes[1])
    notes = " ".join(RunRecord.read(project.record).notes())
    assert "7 of 7 images" in notes
    assert "(1.5000 times by the pixel sizes)" in notes
    before = (merged / "sparse/0/images.bin").stat().st_mtime_ns
    assert main(["map", str(merged), "-q"]) == 0
    assert (merged / "sparse/0/images.bin").stat().st_mtime_ns == before


def test_a_second_merge_removes_what_the_first_left_and_keeps_what_stands(
    merged, small_project, mounted_anew, tmp_path
):
    path = tmp_path / "m"
    shutil.copytree(merged, path)
    merge_projects([small_project, mounted_anew], path, QUICK)
    record, first = (RunRecord.read(p / "run.json") for p in (path, merged))
    assert record.entry("extract").seconds == first.entry("extract").seconds
    other = tmp_path / "other"
    shutil.copytree(mounted_anew, other)
    merge_projects([small_project, other], path, QUICK)
    names = {file.name.split("_")[0] for file in (path / "images").iterdir()}
    assert names == {"p", "other"}


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["{p}"], "two projects or more"),
        (["{p}", "{p}"], "named twice"),
        (["{p}", "{empty}"], "is not a semsfm project"),
        (["{p}", "{missing}"], "is not a semsfm project"),
        (["{p}", "{anew}", "--output_path", "{p}"], "is one of the projects"),
    ],
)
def test_what_cannot_be_merged_is_one_sentence(
    arguments, said, small_project, mounted_anew, tmp_path, capsys
):
    (tmp_path / "empty").mkdir()
    paths = {
        "p": small_project,
        "anew": mounted_anew,
        "empty": tmp_path / "empty",
        "missing": tmp_path / "missing",
    }
    args = [argument.format(**paths) for argument in arguments]
    if "--output_path" not in args:
        args += ["--output_path", str(tmp_path / "m")]
    assert main(["merge", *args]) != 0
    error = capsys.readouterr().err.strip()
    assert said in error
    assert "\n" not in error
    assert not (tmp_path / "m").exists()


def test_a_series_of_another_specimen_is_refused(small_project, tmp_path):
    images = synthesize(tmp_path / "series", replace(SMALL, seed=77))
    other = tmp_path / "other"
    run_stages(other, QUICK, names=("ingest",), image_path=images)
    with pytest.raises(InputError, match=r"no image of other matches one of p: .* was merged$"):
        merge_projects([small_project, other], tmp_path / "m", QUICK)
    assert not (tmp_path / "m" / "sparse").exists()


def test_an_image_that_has_gone_is_named(small_project, mounted_anew, tmp_path):
    broken = tmp_path / "broken"
    shutil.copytree(mounted_anew, broken)
    gone = sorted((broken / "images").iterdir())[2]
    gone.unlink()
    with pytest.raises(InputError, match=gone.name):
        merge_projects([small_project, broken], tmp_path / "m", QUICK)


def test_folders_of_one_name_get_numbers(tmp_path):
    paths = [tmp_path / "x" / "run", tmp_path / "y" / "run", tmp_path / "z" / "run"]
    assert series_labels(paths) == ["run", "run2", "run3"]


def pair(first, second, failure=None):
    return PairStatistics(
        image_name_1=first,
        image_name_2=second,
        num_matches=100,
        num_static_rejected=0,
        num_after_affine_ransac=50,
        num_after_distance_filter=50,
        failure=failure,
    )


def record_of(tmp_path, *pairs):
    record = RunRecord(path=tmp_path / "run.json")
    matched = MatchRecord(num_pairs=len(pairs), num_verified_pairs=0, pairs=pairs)
    return replace(record, stages={"match": StageEntry.done("", 0.0, matched)})


def test_series_without_a_verified_pair_between_them_are_refused(tmp_path):
    frames = tuple(
        SemFrame(
            name=f"{label}{i}",
            width_px=9,
            height_px=9,
            source_path="",
            crop_px=(0, 0, 9, 9),
            series=label,
        )
        for label in "abc"
        for i in range(2)
    )
    series = SemSeries(frames=frames)
    alone = [pair("a0", "a1"), pair("b0", "b1"), pair("c0", "c1")]
    with pytest.raises(InputError, match=r"no image of c matches one of a, b: .* nothing was"):
        check_crossing(
            record_of(tmp_path, *alone, pair("a0", "b0"), pair("b1", "c0", "accidental")), series
        )
    with pytest.raises(InputError, match="no image of b or c matches one of a:"):
        check_crossing(record_of(tmp_path, *alone, pair("b0", "c0")), series)
    # a chain ties all together
    check_crossing(record_of(tmp_path, *alone, pair("b0", "c0"), pair("a0", "c1")), series)
