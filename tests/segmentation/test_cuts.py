from dataclasses import replace

import cv2
import numpy as np
import pytest

from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.geometry.alignment import Similarity
from semsfm_colmap.geometry.rotations import rotation_from_vector
from semsfm_colmap.segmentation.cut_file import read_cuts, write_cuts
from semsfm_colmap.segmentation.cuts import Cut, Views, apply_cuts, left_out
from semsfm_colmap.segmentation.labels import whole
from semsfm_colmap.segmentation.names import COIL, DROPPED, SPECIMEN
from semsfm_colmap.segmentation.world import world_of
from semsfm_colmap.types import PointCloud
from tests.segmentation import shapes

RNG = np.random.default_rng(0)
POINTS = RNG.uniform(-1, 1, (500, 3))
CLOUD = PointCloud(points=POINTS)
VIEWS = Views(
    names=("a.png", "b.png", "c.png"), cameras=shapes.cameras_about("y", np.array([0.0, 10, 20]))
)
WORLDS = [
    world_of(VIEWS.names, shapes.cameras_about("y", np.array([0.0, 10, 20]) + start))
    for start in (0.0, 30.0)
]
ALL_KINDS = [
    Cut(kind="box", values=(-1.0, -0.5, 1e-7, 1.0, 0.5, 2.0)),
    Cut(kind="sphere", values=(0.0, 0.0, 0.0, 0.5), label="specimen", outside=True),
    Cut(kind="plane", values=(0.0, 1.0, 0.0, 0.25), label='a "dirty" name', world=WORLDS[1]),
    Cut(kind="plane", values=(1.0, 1.0, 0.0, 0.0), world=WORLDS[0]),
    Cut(kind="masks", text="C:\\masks of ü"),
    Cut(kind="keep", text="specimen"),
    Cut(kind="drop", text="coil"),
]


def cut(*cuts, labelling=None):
    return apply_cuts(labelling or whole(500, ""), CLOUD, VIEWS, cuts)


@pytest.mark.parametrize(
    ("one", "inside"),
    [
        (
            Cut(kind="box", values=(-0.5, -1, -1, 0.5, 1, 0)),
            (np.abs(POINTS[:, 0]) <= 0.5) & (POINTS[:, 2] <= 0),
        ),
        (
            Cut(kind="sphere", values=(0.2, 0, 0, 0.6)),
            ((POINTS - [0.2, 0, 0]) ** 2).sum(axis=1) <= 0.36,
        ),
        # the normal need not be of unit length
        (Cut(kind="plane", values=(2.0, 0, 0, 0.5)), POINTS[:, 0] > 0.25),
    ],
    ids=["box", "sphere", "plane"],
)
def test_a_shape_takes_what_is_inside_of_it_or_outside(one, inside):
    assert np.array_equal(cut(one).label == DROPPED, inside)
    assert np.array_equal(cut(replace(one, outside=True)).label == DROPPED, ~inside)
    assert len(cut(one).label) == 500


def test_cuts_follow_one_another_and_new_names_get_new_numbers():
    done = cut(
        Cut(kind="plane", values=(1.0, 0, 0, 0), label="left over"),
        Cut(kind="plane", values=(0, 1.0, 0, 0), label="dust"),
        Cut(kind="plane", values=(0, 0, 1.0, 0), label="left over"),
    )
    assert done.names[5] == "left over"
    assert done.names[6] == "dust"
    assert np.array_equal(done.is_part("left over"), (POINTS[:, 2] > 0) | _first_only())


def _first_only():
    return (POINTS[:, 0] > 0) & (POINTS[:, 1] <= 0)


def test_a_cut_of_another_world_takes_the_same_points():
    turn = rotation_from_vector(np.array([0.3, -0.7, 1.1]))
    way = Similarity(rotation=turn @ np.diag([1.0, 1, -1]), scale=3.0, shift=np.array([5.0, 6, 7]))
    moved = PointCloud(points=way.apply(POINTS))
    for one in ALL_KINDS[:3]:
        one = replace(one, label="dropped")
        there = replace(one, world=WORLDS[1])
        done = apply_cuts(whole(500, ""), moved, VIEWS, [there], {WORLDS[1]: way})
        assert np.array_equal(done.label, cut(one).label)
        assert len(np.unique(done.label)) == 2


def test_keep_drops_all_other_parts_and_drop_that_one():
    label = np.where(POINTS[:, 0] > 0, COIL, SPECIMEN)
    labelling = replace(whole(500, ""), label=label)
    kept = cut(Cut(kind="keep", text="specimen"), labelling=labelling)
    dropped = cut(Cut(kind="drop", text="coil"), labelling=labelling)
    assert np.array_equal(kept.label, dropped.label)
    assert np.array_equal(kept.label == DROPPED, label == COIL)


@pytest.mark.parametrize("kind", ["keep", "drop"])
def test_a_part_that_is_not_there_is_named_with_those_that_are(kind):
    with pytest.raises(InputError, match=r"no part named stem .* the parts are specimen"):
        cut(Cut(kind=kind, text="stem"))


def test_masks_take_what_they_leave_out_in_most_images(tmp_path):
    # all white, left half black, left half black: what projects to the left goes
    for name, black in zip(VIEWS.names, (0, 100, 100), strict=True):
        mask = np.full((shapes.HEIGHT, shapes.WIDTH), 255, np.uint8)
        mask[:, :black] = 0
        (tmp_path / f"{name}.png").write_bytes(cv2.imencode(".png", mask)[1].tobytes())
    votes = sum(((POINTS @ VIEWS.cameras.projection[i].T)[:, 0] < 0).astype(int) for i in (1, 2))
    taken = cut(Cut(kind="masks", text=str(tmp_path))).label == DROPPED
    assert np.array_equal(taken, votes == 2)


def test_masks_of_images_that_a_point_does_not_face_have_no_say(tmp_path):
    black = np.zeros((shapes.HEIGHT, shapes.WIDTH), np.uint8)
    (tmp_path / "a.png.png").write_bytes(cv2.imencode(".png", black)[1].tobytes())
    normals = np.where(POINTS[:, :1] > 0, [[0.0, 0, -1]], [[0.0, 0, 1]])
    out = left_out(PointCloud(points=POINTS, normals=normals), VIEWS, tmp_path)
    assert np.array_equal(out, POINTS[:, 0] > 0)


def test_a_folder_without_masks_of_these_images_is_named(tmp_path):
    with pytest.raises(InputError, match=r"holds no mask of these images.*a\.png\.png"):
        cut(Cut(kind="masks", text=str(tmp_path)))


def test_cuts_come_back_from_their_file_as_they_were(tmp_path):
    path = tmp_path / "segments.toml"
    write_cuts(ALL_KINDS, path)
    assert read_cuts(path) == ALL_KINDS
    assert read_cuts(tmp_path / "none.toml") == []


def test_deleting_a_line_takes_that_cut_back(tmp_path):
    path = tmp_path / "segments.toml"
    write_cuts(ALL_KINDS, path)
    for k in range(len(ALL_KINDS)):
        lines = path.read_text(encoding="utf-8").splitlines()
        at = [n for n, line in enumerate(lines) if line.startswith("  { ")][k]
        (tmp_path / "less.toml").write_text("\n".join(lines[:at] + lines[at + 1 :]), "utf-8")
        assert read_cuts(tmp_path / "less.toml") == ALL_KINDS[:k] + ALL_KINDS[k + 1 :]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("cuts = [{ box = [0, 0, 0, 1, 1] }]", "takes 6 finite numbers"),
        ("cuts = [{ box = [0, 0, 0, 1, 1, -1] }]", "upper corner"),
        ("cuts = [{ box = [0, 0, 0, 1, 1, nan] }]", "takes 6 finite numbers"),
        ("cuts = [{ sphere = [0, 0, 0, 0] }]", "positive"),
        ("cuts = [{ plane = [0, 0, 0, 1] }]", "no normal"),
        ("cuts = [{ plane = 3 }]", "numbers are expected"),
        ("cuts = [{ keep = 3 }]", "a text is expected"),
        ('cuts = [{ keep = "" }]', "needs the name"),
        ('cuts = [{ keep = "a", drop = "b" }]', "must name one of"),
        ("cuts = [3]", "must name one of"),
        ('cuts = [{ keep = "a", colour = 1 }]', "unknown key colour"),
        ('cuts = [{ sphere = [0, 0, 0, 1], label = "" }]', "label is empty"),
        ("cuts = [{ sphere = [0, 0, 0, 1], outside = 1 }]", "true or false"),
        ("cuts = [{ sphere = [0, 0, 0, 1], world = 0 }]", "the file has 0 worlds"),
        ("worlds = [[{ image = 3, camera = [1, 2, 3, 4, 5, 6, 7, 8] }]]", "camera = .8 numbers"),
        ('worlds = [[{ image = "a", camera = [1, 2] }]]', "camera = .8 numbers"),
        ("worlds = [3]", "world 0 must be a list"),
        ("worlds = 3", "worlds = 3, but a list is expected"),
        ("cuts = 3", "a list is expected"),
        ("cuts = [", "not valid TOML"),
    ],
)
def test_a_wrong_entry_is_named(text, said, tmp_path):
    path = tmp_path / "segments.toml"
    path.write_text(text)
    with pytest.raises(UsageError, match=said) as caught:
        read_cuts(path)
    assert str(path) in str(caught.value)
