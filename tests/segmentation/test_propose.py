import numpy as np
import pytest

from semsfm_colmap.segmentation.names import COIL, SPECIMEN, STALK, SUBSTRATE
from semsfm_colmap.segmentation.options import SegmentationOptions
from semsfm_colmap.segmentation.propose import propose
from semsfm_colmap.synthetic.options import SynthesizeOptions
from semsfm_colmap.synthetic.visible_cloud import visible_cloud
from semsfm_colmap.types import PointCloud
from tests.segmentation import shapes

MIN_RECALL, MAX_TAKEN = 0.95, 0.02


def proposed(shape):
    return propose(shape.cloud, shape.cameras, shape.image_size_px, SegmentationOptions())


@pytest.mark.parametrize(("holder", "number"), [("stalk", STALK), ("ribbon", COIL)])
@pytest.mark.parametrize("seed", [0, 1])
def test_what_holds_a_ball_from_below_is_told_from_it(holder, number, seed):
    shape = shapes.held_ball(holder, seed)
    found = proposed(shape)
    held = found.label == number
    assert set(np.unique(found.label)) == {SPECIMEN, number}
    assert held[shape.specimen == 0].mean() >= MIN_RECALL
    assert held[shape.specimen == 1].mean() <= MAX_TAKEN
    assert np.all((found.confidence >= 0.5) & (found.confidence <= 1.0))


def test_a_ball_on_a_plate_is_told_from_it():
    shape = shapes.ball_on_plate()
    found = proposed(shape)
    ground = found.label == SUBSTRATE
    assert ground[shape.specimen == 0].mean() >= MIN_RECALL
    # the foot of the ball, up to six deviations of the plate's height, is a matter of the creases
    assert ground[shape.specimen == 1].mean() <= 0.05


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_plate_that_stereo_saw_in_part_is_told_from_the_ball_on_it(seed):
    shape = shapes.ball_on_half_a_plate(seed)
    found = proposed(shape)
    ground = found.label == SUBSTRATE
    assert ground[shape.specimen == 0].mean() >= MIN_RECALL
    assert ground[shape.specimen == 1].mean() <= 0.05
    # where no plate was seen nothing is taken for one
    right = np.asarray(shape.cloud.points)[:, 0] > 0.6
    assert not ground[right].any()


@pytest.mark.parametrize(
    "shape",
    [
        shapes.free_ball(),
        # cut by the lower border: a cap is no stalk
        shapes.free_ball(radius=1.5, offset=np.array([0.0, 1.2, 0.0])),
        shapes.free_ball(radius=1.5, offset=np.array([0.0, 1.5, 0.0])),
        shapes.rough_field(),
        shapes.made(
            [shapes.tube(6000, np.random.default_rng(0), -4.0, 4.0)],
            [1],
            shapes.cameras_about("y", np.arange(0.0, 360.0, 15.0)),
            np.random.default_rng(0),
        ),
    ],
    ids=["free", "cut", "cut deep", "field", "rod through the frame"],
)
def test_a_specimen_that_nothing_holds_stays_whole(shape):
    found = proposed(shape)
    assert np.all(found.label == SPECIMEN)
    assert found.message


@pytest.mark.parametrize("offset", [0.8, 1.2, 1.6, 2.0, 2.4])
@pytest.mark.parametrize("radius", [1.2, 1.8])
def test_the_cap_of_a_ball_that_the_frame_cuts_is_no_stalk(radius, offset):
    found = proposed(shapes.free_ball(radius=radius, offset=np.array([0.0, offset, 0.0])))
    assert np.all(found.label == SPECIMEN)


def test_a_plate_alone_stays_whole():
    rng = np.random.default_rng(0)
    cameras = shapes.cameras_about("x", np.linspace(-6.0, 6.0, 5))
    found = proposed(shapes.made([shapes.plate(9000, rng)], [1], cameras, rng))
    assert np.all(found.label == SPECIMEN)


@pytest.mark.parametrize("num", [0, 1, 150])
def test_a_tiny_cloud_stays_whole(num):
    shape = shapes.held_ball("stalk")
    cloud = PointCloud(
        points=shape.cloud.points[:num], normals=np.asarray(shape.cloud.normals)[:num]
    )
    found = propose(cloud, shape.cameras, shape.image_size_px, SegmentationOptions())
    assert len(found.label) == num
    assert "too few" in found.message


def test_a_cloud_without_normals_stays_whole_and_says_so():
    shape = shapes.held_ball("stalk")
    cloud = PointCloud(points=shape.cloud.points)
    found = propose(cloud, shape.cameras, shape.image_size_px, SegmentationOptions())
    assert np.all(found.label == SPECIMEN)
    assert "normals" in found.message


def test_the_labels_do_not_depend_on_the_unit_or_the_frame_of_the_world():
    from dataclasses import replace

    from semsfm_colmap.geometry.rotations import rotation_from_vector

    shape = shapes.held_ball("ribbon")
    R, unit = rotation_from_vector(np.array([[0.4, -1.1, 0.7]]))[0], 0.037
    moved = replace(
        shape,
        cloud=PointCloud(
            points=unit * shape.cloud.points @ R.T, normals=np.asarray(shape.cloud.normals) @ R.T
        ),
        cameras=replace(
            shape.cameras,
            cam_from_world=shape.cameras.cam_from_world @ R.T,
            scale_px_per_unit=shape.cameras.scale_px_per_unit / unit,
        ),
    )
    assert np.mean(proposed(shape).label == proposed(moved).label) > 0.999


@pytest.mark.slow
@pytest.mark.parametrize("scene", ["clump", "grain", "field"])
@pytest.mark.parametrize("seed", [101, 102])
def test_rendered_specimens_are_told_from_what_holds_them(scene, seed):
    options = SynthesizeOptions(
        scene=scene, seed=seed, num_images=18, width_px=480, height_px=360, databar=False
    )
    seen = visible_cloud(options)
    found = propose(seen.cloud, seen.cameras, seen.image_size_px, SegmentationOptions())
    held, true = found.label != SPECIMEN, seen.label > 0
    assert not true.any() or held[true].mean() >= MIN_RECALL
    assert held[~true].mean() <= MAX_TAKEN
