from __future__ import annotations

import numpy as np
import pytest

from semsfm_colmap.geometry.rotations import rotation_angle, rotation_from_vector
from semsfm_colmap.motion.check import check_tilt
from semsfm_colmap.motion.prior import TiltPrior
from semsfm_colmap.motion.stage import stage_rotations
from semsfm_colmap.refinement.known_angles import stage_angle_prior
from semsfm_colmap.types import Float

TILT = np.deg2rad([15.0] * 4 + [25.0] * 4)
ROTATION = np.deg2rad([-15.0, -5.0, 5.0, 15.0] * 2)
NAMES = tuple(f"{k}.tif" for k in range(8))


def prior(tilt: Float = TILT, rotation: Float = ROTATION) -> TiltPrior:
    return TiltPrior(
        image_names=NAMES,
        angle_rad=tilt,
        sigma_rad=np.full(8, np.deg2rad(0.5)),
        axis_image_rad=None,
        source="header",
        rotation_rad=rotation,
    )


def seen(
    rotation_sign: float = 1.0,
    reversed_: bool = False,
    scan_deg: float = 70.0,
    stretch: float = 1.0,
) -> Float:
    """What the images show: a turned scan, any world, either hand."""
    R = stage_rotations(stretch * TILT, rotation_sign * stretch * ROTATION)
    R = rotation_from_vector(np.array([[0, 0, np.deg2rad(scan_deg)]])) @ R
    R = R @ rotation_from_vector(np.array([[0.3, -1.0, 0.4]]))
    D = np.diag([1.0, 1.0, -1.0])
    return D @ R @ D if reversed_ else R


def test_the_usual_scheme_turns_by_tilt_and_rotation_together() -> None:
    R = stage_rotations(TILT, ROTATION)
    largest = max(rotation_angle(R[a] @ R[b].T) for a in range(8) for b in range(8))
    assert np.rad2deg(largest) == pytest.approx(31.6, abs=0.05)


@pytest.mark.parametrize("rotation_sign", [1.0, -1.0])
@pytest.mark.parametrize("reversed_", [False, True])
def test_right_headers_are_not_accused(rotation_sign: float, reversed_: bool) -> None:
    check = check_tilt(prior(), NAMES, seen(rotation_sign, reversed_))
    assert check.consistent
    assert check.factor == pytest.approx(1.0, abs=1e-6)
    assert check.outliers == ()
    assert "tilt and rotation together" in check.message


@pytest.mark.parametrize("stretch", [0.8, 1.2])
def test_wrong_angles_are_noticed(stretch: float) -> None:
    check = check_tilt(prior(), NAMES, seen(stretch=stretch))
    assert not check.consistent
    assert check.factor == pytest.approx(stretch, rel=0.03)
    assert "check the recorded tilts and rotations" in check.message


def test_rotations_of_another_series_are_noticed() -> None:
    shuffled = ROTATION[[3, 0, 2, 1, 6, 5, 4, 7]]
    check = check_tilt(prior(rotation=shuffled), NAMES, seen())
    assert not check.consistent


def test_one_wrong_entry_is_named() -> None:
    rotation = ROTATION.copy()
    rotation[2] += np.deg2rad(6.0)
    check = check_tilt(prior(rotation=rotation), NAMES, seen())
    assert check.consistent
    assert check.outliers == ("2.tif",)


def test_pairs_of_the_prior_have_the_angles_of_the_stage() -> None:
    pairs = stage_angle_prior(prior(), NAMES)
    assert pairs is not None
    R = seen()
    a, b = pairs.pairs.T
    np.testing.assert_allclose(pairs.angle_rad, rotation_angle(R[a] @ R[b].transpose(0, 2, 1)))
    assert set(pairs.pairs.ravel()) == set(range(8))
