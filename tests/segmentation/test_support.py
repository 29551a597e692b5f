import numpy as np
import pytest

from semsfm_colmap.geometry.normals import sampling_distance
from semsfm_colmap.segmentation.contact import find_contact
from semsfm_colmap.segmentation.options import SegmentationOptions
from semsfm_colmap.segmentation.substrate import find_substrate
from semsfm_colmap.segmentation.support import MAX_LOG_ODDS, find_support, fit_axis_line, log_odds
from tests.segmentation import shapes

OPTIONS = SegmentationOptions()
BOTTOM = 3


def support_of(shape):
    points, normals = np.asarray(shape.cloud.points), np.asarray(shape.cloud.normals)
    contact = find_contact(points, shape.cameras, shape.image_size_px, OPTIONS)
    return find_support(
        points,
        normals,
        contact.touches[:, BOTTOM],
        contact.direction[BOTTOM],
        sampling_distance(points),
        OPTIONS,
    )


def test_a_stalk_touches_the_bottom_alone_and_is_held_along_the_axis():
    shape = shapes.held_ball("stalk")
    contact = find_contact(
        np.asarray(shape.cloud.points), shape.cameras, shape.image_size_px, OPTIONS
    )
    assert contact.touches.any(axis=0).tolist() == [False, False, False, True]
    np.testing.assert_allclose(contact.direction[BOTTOM], [0.0, 1.0, 0.0], atol=1e-12)
    # left and right turn with the specimen
    assert np.linalg.norm(contact.direction[0]) < 1e-9
    # 0.6 units of the width of 5, and the bins that it begins or ends in
    share = 2 * shapes.STALK * shapes.SCALE / shapes.WIDTH
    assert share - 1 / 12 <= contact.coverage[BOTTOM] <= share + 1 / 12


def test_points_at_the_border_are_those_within_the_margin():
    cameras = shapes.cameras_about("y", np.zeros(3))
    size = np.tile([shapes.WIDTH, shapes.HEIGHT], (3, 1))
    margin = OPTIONS.border_margin * shapes.HEIGHT
    x = (np.array([margin - 0.1, margin + 0.1]) - shapes.WIDTH / 2) / shapes.SCALE
    points = np.column_stack([x, np.zeros(2), np.zeros(2)])
    contact = find_contact(points, cameras, size, OPTIONS)
    assert contact.touches.tolist() == [[True, False, False, False], [False] * 4]


@pytest.mark.parametrize("holder", ["stalk", "ribbon"])
def test_the_neck_is_where_the_ball_begins(holder):
    found = support_of(shapes.held_ball(holder))
    assert found is not None
    # the ball is as wide as the limit at this height, and the slices are 3 spacings long
    height = np.sqrt(shapes.BALL**2 - found.limit**2)
    assert height - 0.3 < found.neck < np.sqrt(shapes.BALL**2 - shapes.STALK**2) + 0.3
    assert 1.15 * shapes.STALK < found.limit < 1.4 * shapes.STALK


def test_a_ribbon_is_a_helix_of_its_pitch_and_a_stalk_is_none():
    assert support_of(shapes.held_ball("stalk")).phase is None
    shape = shapes.held_ball("ribbon")
    phase = support_of(shape).phase
    ring = np.exp(2j * np.pi * phase[shape.specimen == 0])
    # half of a turn covered: |mean| = 2 / pi
    assert abs(abs(ring.mean()) - 2 / np.pi) < 0.03


def test_the_axis_of_a_tilted_cylinder_is_found_in_spite_of_strays():
    rng = np.random.default_rng(0)
    s, phi = rng.uniform(0, 3, 2000), rng.uniform(0, 2 * np.pi, 2000)
    a0, a1 = np.array([0.4, -0.2]), np.array([0.05, 0.1])
    across = a0 + s[:, None] * a1 + 0.5 * np.stack([np.cos(phi), np.sin(phi)], axis=1)
    across[:100] += rng.normal(0, 1.0, (100, 2))
    np.testing.assert_allclose(fit_axis_line(s, across), [*a0, *a1, 0.5], atol=0.02)


def test_the_cues_speak_for_the_stalk_on_it_and_against_it_on_the_ball():
    shape = shapes.held_ball("stalk")
    found = support_of(shape)
    odds = log_odds(found, np.full(len(shape.specimen), 0.01))
    assert np.median(odds[shape.specimen == 0]) > 2.0
    assert np.median(odds[shape.specimen == 1]) < 0.0
    assert np.abs(odds).max() <= MAX_LOG_ODDS


def test_the_height_of_a_ball_above_its_plate_is_its_own():
    shape = shapes.ball_on_plate()
    points = np.asarray(shape.cloud.points)
    contact = find_contact(points, shape.cameras, shape.image_size_px, OPTIONS)
    assert contact.total_coverage > 0.9
    sheet = find_substrate(
        points,
        contact.touches.any(axis=1),
        shape.cameras.viewing_direction.mean(axis=0),
        sampling_distance(points),
        OPTIONS,
    )
    assert sheet is not None
    np.testing.assert_allclose(sheet.height, -points[:, 2], atol=0.03)
    assert shapes.BALL - 0.1 < sheet.height[sheet.raised].max() < shapes.BALL + 0.1
    assert shape.specimen[sheet.raised].mean() > 0.99


@pytest.mark.parametrize("num", [0, 20])
def test_too_few_points_at_the_border_make_no_sheet(num):
    points = np.random.default_rng(0).normal(size=(500, 3))
    touches = np.arange(500) < num
    assert find_substrate(points, touches, np.array([0.0, 0, 1]), 0.1, OPTIONS) is None
