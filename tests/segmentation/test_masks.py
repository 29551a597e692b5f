import numpy as np
import pytest

from semsfm_colmap.geometry.normals import sampling_distance
from semsfm_colmap.segmentation.labels import whole
from semsfm_colmap.segmentation.masks import MARGIN_PX, part_mask
from semsfm_colmap.segmentation.picture import BACKGROUND, draw_parts
from semsfm_colmap.segmentation.splat import first_points
from tests.oracles import segmentation as oracle
from tests.segmentation import shapes


@pytest.mark.parametrize("cell", [1.0, 2.5])
def test_each_cell_shows_the_nearest_point(cell):
    rng = np.random.default_rng(0)
    uv = rng.uniform(-5, 35, (200, 2))
    depth = rng.normal(size=200)
    found = first_points(uv, depth, (30, 20), cell)
    assert np.array_equal(found, oracle.first_points(uv, depth, (30, 20), cell))


def mask_of(shape, part, image_idx=0):
    points = np.asarray(shape.cloud.points)
    return part_mask(
        points,
        part,
        shape.cameras,
        image_idx,
        (shapes.WIDTH, shapes.HEIGHT),
        sampling_distance(points),
    )


def test_the_mask_of_a_ball_is_its_disc_and_a_margin():
    shape = shapes.free_ball()
    mask = mask_of(shape, np.ones(len(shape.specimen), dtype=bool))
    assert mask.shape == (shapes.HEIGHT, shapes.WIDTH)
    assert set(np.unique(mask)) == {0, 255}
    y, x = np.mgrid[: shapes.HEIGHT, : shapes.WIDTH] + 0.5
    r = np.hypot(x - shapes.WIDTH / 2, y - shapes.HEIGHT / 2)
    radius = shapes.BALL * shapes.SCALE
    assert np.all(mask[r < radius - 1] == 255)
    # a point fills its cell and those around it: as far as two diagonals
    cell = sampling_distance(np.asarray(shape.cloud.points)) * shapes.SCALE
    assert np.all(mask[r > radius + MARGIN_PX + 1 + 2 * np.sqrt(2) * cell] == 0)


def test_what_is_in_front_of_a_part_is_not_in_its_mask():
    shape = shapes.free_ball()
    # camera 0 looks along z: the far half is hidden by the near one
    far = np.asarray(shape.cloud.points)[:, 2] > 0.3
    mask = mask_of(shape, far)
    middle = mask[shapes.HEIGHT // 2 - 20 : shapes.HEIGHT // 2 + 20, 80:120]
    assert np.mean(middle > 0) < 0.02


def test_a_part_without_points_has_an_empty_mask():
    shape = shapes.free_ball()
    assert not mask_of(shape, np.zeros(len(shape.specimen), dtype=bool)).any()


def test_the_picture_shows_every_part_in_its_colour():
    from dataclasses import replace

    shape = shapes.held_ball("stalk")
    labelling = whole(len(shape.specimen), "")
    labelling = replace(labelling, label=np.where(shape.specimen == 1, 1, 3))
    views = list(shape.cameras.cam_from_world[[0, 3, 6]])
    spacing = sampling_distance(np.asarray(shape.cloud.points))
    drawn = draw_parts(shape.cloud, labelling, views, spacing)
    assert drawn.shape[1:] == (1280, 3)
    panel = drawn[:480, :640].astype(int)
    blue = panel[..., 2] > panel[..., 0]
    orange = panel[..., 0] > panel[..., 2]
    assert 0.1 < blue.mean() < 0.5
    assert 0.005 < orange.mean() < 0.2
    # three views leave the fourth panel empty
    assert np.all(drawn[480:960, 640:] == BACKGROUND)
