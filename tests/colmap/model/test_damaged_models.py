"""Models of others come damaged: one sentence each, before pycolmap believes their counts."""

import shutil
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from semsfm_colmap.colmap.library import pycolmap
from semsfm_colmap.colmap.model.any_model import read_any_model
from semsfm_colmap.colmap.model.contents import PARAMETERS
from semsfm_colmap.colmap.model.pinhole_reading import read_pinhole_model
from semsfm_colmap.colmap.model.text_contents import MODELS
from semsfm_colmap.errors import InputError
from tests.colmap.perspective_models import around, ball, perspective_model, write_model

SCRIPT = Path(__file__).parents[3] / "scripts/fuzz_models.py"
FILES = ("cameras", "images", "points3D", "rigs", "frames")


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    folder = tmp_path_factory.mktemp("model")
    model = perspective_model(ball(40), around(5), names=[f"a {i}.png" for i in range(5)])
    write_model(model, folder / "bin")
    write_model(model, folder / "txt", text=True)
    return folder


@pytest.fixture
def model(sound, tmp_path):
    return Path(shutil.copytree(sound, tmp_path / "m"))


def test_the_camera_models_are_those_of_pycolmap():
    # version 4.0 knows the first ones
    known = len(pycolmap.CameraModelId.__members__) - 1  # INVALID is one of them
    assert known >= 16
    for number, (name, count) in enumerate(zip(MODELS[:known], PARAMETERS[:known], strict=True)):
        camera = pycolmap.Camera.create_from_model_id(
            1, pycolmap.CameraModelId(number), 10.0, 10, 10
        )
        assert (camera.model_name, len(camera.params)) == (name, count)


@pytest.mark.parametrize("file", FILES)
@pytest.mark.parametrize("share", [0.0, 0.03, 0.5, 0.97])
def test_a_cut_file_is_named(model, file, share):
    path = model / "bin" / f"{file}.bin"
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(InputError, match=rf"{file}\.bin is damaged"):
        read_any_model(model / "bin")


def test_a_text_cut_within_a_line_names_the_line(model):
    path = model / "txt" / "points3D.txt"
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines[:9], lines[9][:20]]))
    with pytest.raises(InputError, match=r"points3D\.txt is damaged \(line 10"):
        read_any_model(model / "txt")


@pytest.mark.parametrize("file", FILES)
@pytest.mark.parametrize("count", [2**63, 2**40, 10**6])
def test_a_count_is_held_against_the_size_of_the_file(model, file, count):
    path = model / "bin" / f"{file}.bin"
    path.write_bytes(struct.pack("<Q", count) + path.read_bytes()[8:])
    with pytest.raises(InputError, match=rf"{file}\.bin is damaged \({count} entries"):
        read_pinhole_model(model / "bin")


def test_a_model_damaged_at_random_is_read_or_refused_in_bounded_time_and_memory(tmp_path):
    """Thousands of them: `python scripts/fuzz_models.py --seconds 600`, docs/reliability.md."""
    done = subprocess.run(
        [sys.executable, str(SCRIPT), "--trials", "250", "--findings", str(tmp_path)],
        capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr[-2000:]
    assert "250 damaged models" in done.stdout


@pytest.mark.parametrize("end", ["bin", "txt"])
@pytest.mark.parametrize("name", ["../x.png", "/tmp/x.png", "a/../../x.png", "C:\\x.png", "\\x"])
def test_a_name_that_leaves_the_image_folder_is_refused(tmp_path, end, name):
    names = [name, *(f"{i}.png" for i in range(4))]
    folder = write_model(
        perspective_model(ball(40), around(5), names=names), tmp_path / "m", text=end == "txt"
    )
    with pytest.raises(InputError, match=rf"images\.{end} names the image .*rename"):
        read_any_model(folder)


@pytest.mark.parametrize("missing", ["cameras", "images"])
@pytest.mark.parametrize("end", ["bin", "txt"])
def test_a_missing_file_is_named(model, missing, end):
    (model / end / f"{missing}.{end}").unlink()
    with pytest.raises(InputError, match=rf"no {missing}\.{end}"):
        read_any_model(model / end)


@pytest.mark.parametrize("end", ["bin", "txt"])
def test_the_three_classic_files_alone_are_a_model(model, end):
    whole = read_any_model(model / end)
    for name in ("rigs", "frames"):
        (model / end / f"{name}.{end}").unlink()
    assert np.array_equal(read_any_model(model / end).points, whole.points)


def test_a_text_of_windows_is_read_as_any_other(model):
    whole = read_any_model(model / "txt")
    for path in (model / "txt").iterdir():
        path.write_bytes(path.read_bytes().replace(b"\n", b"\r\n"))
    read = read_any_model(model / "txt")
    assert np.array_equal(read.cam_from_world, whole.cam_from_world)
    assert np.array_equal(read.points, whole.points)


@pytest.mark.parametrize("what", ["point", "pose"])
def test_what_is_not_finite_is_no_part_of_an_orthographic_model(model, what):
    path = model / "txt" / ("points3D.txt" if what == "point" else "images.txt")
    lines = path.read_text().splitlines()
    first = next(k for k, line in enumerate(lines) if not line.startswith("#"))
    words = lines[first].split()
    words[2] = "nan"
    lines[first] = " ".join(words)
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(InputError, match="finite" if what == "point" else "pose"):
        read_pinhole_model(model / "txt", max_deviation_px=1e9)


def test_numbers_that_none_can_reckon_with_are_refused_as_nan_is(model):
    cameras = model / "txt" / "cameras.txt"
    lines = cameras.read_text().splitlines()
    cameras.write_text("\n".join([*lines[:-1], lines[-1].rpartition(" ")[0] + " 1e200"]))
    with pytest.raises(InputError, match=r"cameras\.txt is damaged .*not a finite number"):
        read_any_model(model / "txt")


def test_a_point_too_far_to_reckon_with_is_left_out_as_one_at_nan(model):
    points = model / "txt" / "points3D.txt"
    text = points.read_text()
    line = next(line for line in text.splitlines() if not line.startswith("#"))
    fields = line.split(" ")
    points.write_text(text.replace(line, " ".join([fields[0], "1e200", *fields[2:]])))
    count = len(read_any_model(model / "bin").points)
    assert len(read_any_model(model / "txt").points) == count - 1
    with pytest.raises(InputError, match="1 points at places that are not finite"):
        read_pinhole_model(model / "txt", max_deviation_px=1e9)


def test_names_with_spaces_come_out_of_a_text_model_whole(model):
    read = read_any_model(model / "txt")
    assert read.image_names == read_any_model(model / "bin").image_names
    assert read.image_names[1] == "a 1.png"
