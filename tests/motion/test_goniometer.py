import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from semsfm_colmap.motion.belt import START_DEG_PER_UM, predicted_angles, unit_doubt
from semsfm_colmap.motion.goniometer import (
    Readout,
    image_frame_of_axis,
    measure_goniometer,
)
from semsfm_colmap.motion.goniometer_record import goniometer_record
from semsfm_colmap.types import OrthographicCameras
from tests.motion.turning import cameras as rotations

AXIS = np.array([0.97, 0.2, -0.1]) / np.linalg.norm([0.97, 0.2, -0.1])
FACTOR = 150.0


def unread(num):
    return Readout(value=np.full(num, np.nan))


def cameras_of(R):
    return OrthographicCameras(
        cam_from_world=R,
        scale_px_per_unit=np.ones(len(R)),
        translation_px=np.full((len(R), 2), 100.0),
    )


def measured(R, displacement=None, tilt=None, covariance=None, stretch=0.0):
    num = len(R)
    return measure_goniometer(
        cameras_of(R),
        np.zeros(3),
        displacement=unread(num) if displacement is None else Readout(value=displacement),
        tilt=unread(num) if tilt is None else Readout(value=tilt),
        covariance=covariance,
        stretch=stretch,
    )


def recorded(found, displacement, tilt=None, **more):
    num = len(displacement)
    return goniometer_record(
        found,
        [f"{k}.png" for k in range(num)],
        Readout(value=displacement),
        unread(num) if tilt is None else Readout(value=tilt),
        model="m",
        displacement_source="table d.csv",
        pixel_size_um=None,
        **more,
    )


def test_the_angle_grows_with_the_displacement_whichever_way_the_series_turns():
    angles = np.arange(0.0, 120.0, 5.0)
    up, down = angles / FACTOR, -angles / FACTOR
    for displacement, side in ((up, 1.0), (down, -1.0)):
        found = measured(rotations(angles), displacement)
        assert np.rad2deg(found.displacement.slope) == pytest.approx(FACTOR, rel=1e-9)
        np.testing.assert_allclose(found.series.axis_camera, side * AXIS, atol=1e-9)
        np.testing.assert_allclose(np.rad2deg(found.series.angle_rad), side * angles, atol=1e-7)


def test_a_shuffled_series_of_three_turns_is_put_into_order_by_its_displacements():
    angles = np.random.default_rng(0).permutation(np.arange(0.0, 1080.0, 20.0))
    found = measured(rotations(angles), angles / FACTOR)
    assert not found.in_order
    np.testing.assert_array_equal(found.order, np.argsort(angles))
    assert np.rad2deg(found.series.range_rad) == pytest.approx(1060.0)
    assert np.rad2deg(found.displacement.slope) == pytest.approx(FACTOR, rel=1e-9)


def test_a_shuffled_turn_is_put_into_order_by_its_angles_alone():
    angles = np.random.default_rng(1).permutation(np.arange(0.0, 350.0, 7.0))
    found = measured(rotations(angles))
    assert not found.in_order
    assert abs(np.diff(angles[found.order])) == pytest.approx(7.0)


def test_frames_without_a_displacement_stay_on_the_turn_of_their_neighbours():
    angles = np.arange(0.0, 700.0, 10.0)
    displacement = angles / FACTOR
    displacement[[0, 20, 21, 69]] = np.nan
    found = measured(rotations(angles), displacement)
    np.testing.assert_allclose(np.rad2deg(found.series.angle_rad), angles, atol=1e-7)
    record = recorded(found, displacement)
    assert record.images["20.png"].displacement_um is None
    assert record.images["20.png"].residual_deg is None
    assert record.displacement.num_images == 66


def test_a_run_there_and_back_with_two_degrees_of_hysteresis():
    rng = np.random.default_rng(2)
    readout = np.concatenate([np.linspace(0.0, 0.8, 25), np.linspace(0.8, 0.0, 25)])
    way = np.repeat([1.0, -1.0], 25)
    angles = FACTOR * readout + way + 0.15 * rng.normal(size=50)
    record = recorded(measured(rotations(angles), readout), readout)
    assert record.hysteresis_deg.value == pytest.approx(2.0, abs=0.3)
    assert record.hysteresis_deg.value == pytest.approx(2.0, abs=4 * record.hysteresis_deg.sigma)
    assert any("hysteresis" in note for note in record.notes)


def test_a_stage_has_a_ratio_a_backlash_and_a_repeatability():
    rng = np.random.default_rng(3)
    readout = np.concatenate([np.linspace(-30, 30, 13), np.linspace(30, -30, 13)])
    way = np.repeat([1.0, -1.0], 13)
    angles = 0.98 * readout + 0.25 * way + 0.02 * rng.normal(size=26)
    tilt = np.radians(readout)
    record = recorded(measured(rotations(angles), tilt=tilt), np.full(26, np.nan), tilt)
    assert record.conversion_deg_per_um is None
    assert record.tilt_ratio.value == pytest.approx(0.98, abs=0.002)
    assert record.tilt.hysteresis_deg.value == pytest.approx(0.5, abs=0.05)
    assert record.tilt.scatter_deg == pytest.approx(0.02, rel=0.6)
    assert any("backlash" in note for note in record.notes)


def test_a_wrong_displacement_is_named():
    rng = np.random.default_rng(4)
    angles = np.arange(0.0, 200.0, 5.0) + 0.1 * rng.normal(size=40)
    displacement = np.arange(0.0, 200.0, 5.0) / FACTOR
    displacement[17] += 0.1
    record = recorded(measured(rotations(angles), displacement), displacement)
    assert record.displacement.outliers == ("17.png",)
    assert any("17.png does not fit" in note for note in record.notes)


def test_nanometres_in_a_column_of_micrometres_are_noticed():
    angles = np.arange(0.0, 200.0, 5.0)
    displacement = 1000.0 * angles / FACTOR
    record = recorded(measured(rotations(angles), displacement), displacement)
    assert any("nanometres" in note for note in record.notes)
    assert unit_doubt(FACTOR) == ""
    assert "millimetres" in unit_doubt(1000.0 * FACTOR)


@pytest.mark.parametrize(
    ("angles", "closing_deg"),
    [
        (np.arange(0.0, 356.0, 5.0), 5.0),
        (-np.arange(0.0, 356.0, 5.0), 5.0),
        (np.arange(0.0, 180.0, 5.0), None),
        (np.arange(0.0, 900.0, 20.0), None),
        (np.concatenate([np.arange(0.0, 356.0, 5.0), np.arange(355.0, -1.0, -5.0)]), None),
    ],
    ids=["a turn", "backward", "half a turn", "several turns", "there and back"],
)
def test_one_turn_is_closed_by_a_step_and_other_series_by_none(angles, closing_deg):
    record = recorded(measured(rotations(angles)), np.full(len(angles), np.nan))
    if closing_deg is None:
        assert record.turn is None
    else:
        assert record.turn.closing_step_deg == pytest.approx(closing_deg)
        assert record.turn.minus_median_step_deg == pytest.approx(0.0, abs=1e-9)


def test_nothing_that_turns_gives_no_goniometer():
    assert measured(rotations(np.zeros(8))) is None


def test_the_sigma_of_the_angles_is_that_of_their_differences_from_the_mean():
    angles = np.arange(0.0, 60.0, 5.0)
    R, num = rotations(angles), 12
    # one common turn of the world about the axis and no other error: no angle between images errs
    g = np.tile(AXIS, num)
    found = measured(R, covariance=1e-4 * np.outer(g, g))
    np.testing.assert_allclose(found.angle_sigma_rad, 0.0, atol=1e-9)
    own = 1e-3
    found = measured(R, covariance=own**2 * np.eye(3 * num))
    np.testing.assert_allclose(found.angle_sigma_rad, own * np.sqrt(1.0 - 1.0 / num), rtol=1e-6)


def test_a_stretch_of_all_angles_is_in_the_sigma_of_the_conversion():
    angles = np.arange(0.0, 120.0, 5.0)
    tiny = 1e-14 * np.eye(3 * len(angles))
    found = measured(rotations(angles), angles / FACTOR, covariance=tiny, stretch=0.003)
    assert found.displacement.slope_sigma / found.displacement.slope == pytest.approx(
        0.003, rel=1e-3
    )


@pytest.mark.parametrize("range_deg", [60.0, 350.0])
def test_pulls_of_the_axis_under_wobble_and_correlated_errors_of_the_poses(range_deg):
    angles = np.linspace(0.0, range_deg, 30)
    clean, num = rotations(angles), 30
    mode = 0.002 * np.random.default_rng(9).normal(size=(3 * num, 2))
    covariance = mode @ mode.T + 0.0005**2 * np.eye(3 * num)
    pulls = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        wobble = np.radians(0.1) * rng.normal(size=(num, 3))
        error = (mode @ rng.normal(size=2)).reshape(num, 3) + 0.0005 * rng.normal(size=(num, 3))
        R = Rotation.from_rotvec(error + wobble).as_matrix() @ clean
        found = measured(R, covariance=covariance)
        off = found.series.axis_camera @ image_frame_of_axis(AXIS)
        pulls.append(off / np.sqrt(np.diag(found.axis_covariance_rad2)))
        largest = np.linalg.eigvalsh(found.axis_covariance_rad2)[-1]
        assert found.axis_sigma_rad == pytest.approx(np.sqrt(largest))
    # of sixty draws with two common errors
    rms = np.sqrt(np.mean(np.square(pulls), axis=0))
    assert np.all((rms > 0.7) & (rms < 1.3)), rms


def test_the_axis_of_an_image_errs_as_its_pose_does():
    angles = np.linspace(0.0, 350.0, 40)
    clean, own = rotations(angles), 1e-3
    covariance = own**2 * np.eye(3 * len(angles))
    off = []
    for seed in range(40):
        error = own * np.random.default_rng(seed).normal(size=(len(angles), 3))
        R = Rotation.from_rotvec(error).as_matrix() @ clean
        found = measured(R, covariance=covariance)
        off.append(found.axis_offset_rad)
    np.testing.assert_allclose(found.axis_offset_sigma_rad, own, rtol=0.08)
    assert np.std(off) == pytest.approx(np.mean(found.axis_offset_sigma_rad), rel=0.05)
    assert measured(clean).axis_offset_sigma_rad is None


def test_the_axis_of_an_image_is_said_in_the_image_plane_and_out_of_it():
    np.testing.assert_allclose(
        image_frame_of_axis(np.array([1.0, 0.0, 0.0])), [[0, 0], [1, 0], [0, 1]], atol=1e-15
    )
    F = image_frame_of_axis(AXIS)
    np.testing.assert_allclose(F.T @ F, np.eye(2), atol=1e-12)
    np.testing.assert_allclose(AXIS @ F, 0.0, atol=1e-12)
    assert F[2, 0] == 0.0
    assert F[2, 1] > 0.0
    # an axis along the view has no direction in the image: any will do
    F = image_frame_of_axis(np.array([0.0, 0.0, 1.0]))
    np.testing.assert_allclose(F.T @ F, np.eye(2), atol=1e-12)


def test_the_forward_model_is_the_papers_belt_from_the_smallest_displacement():
    np.testing.assert_allclose(
        np.rad2deg(predicted_angles(np.array([3.0, 2.0, 2.5]))),
        START_DEG_PER_UM * np.array([1.0, 0.0, 0.5]),
    )
