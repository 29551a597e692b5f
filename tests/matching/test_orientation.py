import cv2
import numpy as np
import pytest

from semsfm_colmap.colmap.sift_features import sift_features
from semsfm_colmap.matching.orientation import Trial, pilot_images, try_orientations


@pytest.mark.parametrize("num_images", [3, 4, 6, 7, 13, 19, 20, 48, 300])
def test_the_trial_is_made_on_images_of_the_series(num_images):
    trios = pilot_images(num_images)
    assert len(trios) == (2 if num_images >= 20 else 1)
    for near, following, far in trios:
        assert 0 <= near < following < num_images
        assert following < far < num_images


@pytest.mark.parametrize(
    ("near", "far", "upright"),
    [
        ((1294, 1324), (280, 431), True),  # small steps: the gain is in the far pairs
        ((4573, 4428), (77, 279), True),  # a loss within the scatter
        ((201, 435), (0, 0), True),  # wide steps: far pairs share nothing
        ((899, 801), (560, 559), False),
        ((107, 121), (0, 0), False),  # a gain within the scatter
        ((500, 900), (300, 100), False),  # neighbours gain, farther ones lose: a slow turn
        ((0, 0), (0, 0), False),
    ],
)
def test_upright_has_to_gain_somewhere_and_to_lose_nowhere(near, far, upright):
    assert Trial(near=near, far=far).upright is upright


def series_of(tmp_path, transforms):
    """One texture under 2 x 2 transforms about its centre: the features of its images by SIFT."""
    rng = np.random.default_rng(0)
    texture = np.zeros((600, 600), dtype=np.float32)
    for sigma in (1.5, 3.0, 6.0, 12.0):
        layer = cv2.GaussianBlur(rng.normal(size=texture.shape).astype(np.float32), (0, 0), sigma)
        texture += layer / layer.std()
    texture = np.clip(128 + 30 * texture, 0, 255)
    for k, A in enumerate(transforms):
        move = np.column_stack([A, np.array([160, 160]) - np.asarray(A) @ [300, 300]])
        image = cv2.warpAffine(texture, move, (320, 320), flags=cv2.INTER_AREA)
        noisy = np.clip(image + rng.normal(size=image.shape) * 4, 0, 255)
        cv2.imwrite(str(tmp_path / f"{k}.png"), noisy.astype(np.uint8))

    def features_of(images, upright):
        return sift_features(
            "colmap-sift",
            tmp_path,
            [f"{k}.png" for k in images],
            [(320, 320)] * len(images),
            max_num_features=2000,
            upright=upright,
            first_octave=0,
        )

    return len(transforms), features_of


def turn(deg):
    c, s = np.cos(np.deg2rad(deg)), np.sin(np.deg2rad(deg))
    return np.array([[c, -s], [s, c]])


def test_a_tilted_texture_is_matched_upright(tmp_path):
    squeezed = [np.diag([np.cos(np.deg2rad(a)), 1.0]) for a in (0, 25, 40, 52)]
    assert try_orientations(*series_of(tmp_path, squeezed)).upright


def test_a_texture_that_turns_in_the_image_is_not(tmp_path):
    turned = series_of(tmp_path, [turn(a) for a in (0, 40, 80, 120)])
    trial = try_orientations(*turned)
    assert not trial.upright
    assert trial.near[0] > 5 * trial.near[1]


def test_a_slow_turn_in_the_image_is_seen_in_the_farther_pairs(tmp_path):
    turned = series_of(tmp_path, [turn(a) for a in range(0, 91, 15)])
    trial = try_orientations(*turned)
    assert not trial.upright
    assert trial.far[0] > 2 * trial.far[1]
