import numpy as np
import pytest

from semsfm_colmap.motion.axis import fit_axis
from semsfm_colmap.motion.order import is_in_order, order_by_angle
from tests.motion.turning import cameras

FORWARD = np.arange(0.0, 120.0, 5.0)


@pytest.mark.parametrize(
    "angles",
    [
        FORWARD,
        -FORWARD,
        np.concatenate([FORWARD, FORWARD[::-1]]),
        np.arange(0.0, 900.0, 25.0),
        np.repeat(np.arange(0.0, 60.0, 5.0), 2),
    ],
    ids=["forward", "backward", "there and back", "several turns", "each angle twice"],
)
def test_series_that_follow_the_rotation_are_in_order(angles):
    assert is_in_order(fit_axis(cameras(angles, noise_deg=0.02)))


@pytest.mark.parametrize("seed", range(5))
def test_shuffled_series_are_not_and_their_angles_put_them_into_order(seed):
    shuffled = np.random.default_rng(seed).permutation(np.arange(0.0, 355.0, 5.0))
    R = cameras(shuffled)
    series = fit_axis(R)
    assert not is_in_order(series)
    order = order_by_angle(series)
    steps = np.diff(shuffled[order])
    # forward or backward; the turn is opened at its largest gap
    np.testing.assert_allclose(np.abs(steps), 5.0)
    assert len(set(np.sign(steps))) == 1


def test_three_images_are_never_out_of_order():
    assert is_in_order(fit_axis(cameras(np.array([0.0, 10.0, 5.0]))))
