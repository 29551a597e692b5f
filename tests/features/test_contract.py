"""What every detector and every descriptor promises; new ones inherit these tests."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.errors import UsageError
from semsfm_colmap.features.options import DetectorOptions
from semsfm_colmap.features.registry import DESCRIPTORS, DETECTORS, describe, detect, extract
from tests.features.images import textured

UNION = "harris-laplace+edge-laplace"
EVERY_DETECTOR = [*DETECTORS, UNION]
UPRIGHT = DetectorOptions(upright=True)


def matched_positions(first, second, radius):
    """Distance of each feature of `first` to the nearest one of `second`."""
    from scipy.spatial import cKDTree

    return cKDTree(second).query(first, distance_upper_bound=radius)[0]


@pytest.mark.parametrize("name", EVERY_DETECTOR)
class TestDetector:
    def test_shapes_and_ranges_hold(self, name):
        image = textured()
        features = detect(name, image)
        K = len(features.xy)
        assert K > 100
        assert features.xy.shape == (K, 2)
        assert features.xy.dtype == np.float64
        assert features.affine_shape.shape == (K, 2, 2)
        assert features.descriptors.shape == (K, 0)
        for values in (features.scale_px, features.angle_rad, features.response):
            assert values.shape == (K,)
            assert np.all(np.isfinite(values))
        h, w = image.shape
        assert np.all((features.xy > 0) & (features.xy < [w, h]))
        assert np.all((features.scale_px > 0.5) & (features.scale_px <= 40))
        assert np.allclose(np.linalg.det(features.affine_shape), features.scale_px**2)

    def test_masked_places_have_no_features(self, name):
        image = textured()
        mask = np.ones(image.shape, dtype=bool)
        mask[:, 200:] = False
        mask[:60, :80] = False
        features = detect(name, image, mask=mask)
        assert len(features.xy) > 50
        column, row = np.floor(features.xy).astype(int).T
        assert mask[row, column].all()
        # not only the centre: the border of the mask itself attracts nothing
        assert np.all(features.xy[:, 0] + features.scale_px <= 201.0)

    def test_what_lies_under_the_mask_does_not_matter_away_from_it(self, name):
        image = textured()
        mask = np.ones(image.shape, dtype=bool)
        mask[:, 200:] = False
        other = image.copy()
        other[:, 200:] = 255.0
        a, b = (detect(name, i, UPRIGHT, mask) for i in (image, other))
        # the blur of the scales up to 5 px reaches no further than 60 px
        chosen = (a.xy[:, 0] < 120) & (a.scale_px < 5)
        assert chosen.sum() > 50
        assert np.mean(matched_positions(a.xy[chosen], b.xy, 0.1) < 0.05) > 0.99

    def test_features_move_with_the_image(self, name):
        big = textured((272, 352))
        first, second = big[:240, :320], big[32:, 16:336]
        options = DetectorOptions(upright=True, max_num_features=0, max_scale_px=8.0)
        a, b = (detect(name, i, options) for i in (first, second))
        expected = a.xy - [16.0, 32.0]
        away = np.all((expected > 40) & (expected < [264, 168]), axis=1)
        assert away.sum() > 50
        assert np.mean(matched_positions(expected[away], b.xy, 1.0) < 0.05) > 0.95

    def test_gain_and_offset_do_not_matter(self, name):
        image = textured()
        a, b = detect(name, image), detect(name, 0.6 * image + 31.0)
        assert abs(len(a.xy) - len(b.xy)) <= 0.01 * len(a.xy)
        assert np.mean(matched_positions(a.xy, b.xy, 1.0) < 0.02) > 0.98

    def test_the_same_image_gives_the_same_features(self, name):
        image = textured()
        a, b = detect(name, image), detect(name, image.copy())
        assert np.array_equal(a.xy, b.xy)
        assert np.array_equal(a.affine_shape, b.affine_shape)

    def test_flat_and_black_images_have_no_features(self, name):
        for value in (0.0, 128.0):
            features = detect(name, np.full((100, 120), value))
            assert features.xy.shape == (0, 2)
            assert features.affine_shape.shape == (0, 2, 2)

    def test_tiny_images_are_no_error(self, name):
        for shape in ((1, 1), (3, 40), (12, 12), (17, 23)):
            features = detect(name, textured((64, 64))[: shape[0], : shape[1]])
            assert np.all(features.xy < [shape[1], shape[0]])

    def test_a_fully_masked_image_has_no_features(self, name):
        image = textured()
        assert len(detect(name, image, mask=np.zeros(image.shape, dtype=bool)).xy) == 0

    def test_the_limit_holds_and_spreads_the_features(self, name):
        image = textured()
        image[:, 160:] = 128.0 + 0.5 * (image[:, 160:] - 128.0)
        limited = detect(name, image, DetectorOptions(max_num_features=100))
        assert len(limited.xy) == 100
        # the right half has half the contrast; strength alone would leave it out
        assert np.sum(limited.xy[:, 0] > 170) >= 10

    def test_upright_features_have_no_angle_and_others_have_many(self, name):
        image = textured()
        assert np.all(detect(name, image, UPRIGHT).angle_rad == 0.0)
        angles = detect(name, image).angle_rad
        assert len(np.unique(np.floor(angles / (np.pi / 4)))) == 8


@pytest.mark.parametrize("name", DESCRIPTORS)
class TestDescriptor:
    def test_shapes_and_ranges_hold(self, name):
        features = extract("hessian-laplace", name, textured())
        K = len(features.xy)
        assert features.descriptors.shape[0] == K
        assert features.descriptors.dtype == np.float32
        assert np.all(np.isfinite(features.descriptors))
        if DESCRIPTORS[name].colmap:
            assert features.descriptors.shape == (K, 128)
            assert features.descriptors.min() >= 0.0
            assert np.allclose(np.linalg.norm(features.descriptors, axis=1), 1.0, atol=1e-5)

    def test_gain_and_offset_do_not_matter(self, name):
        image = textured()
        features = detect("hessian-laplace", image)
        a = describe(name, image, features).descriptors
        b = describe(name, 0.6 * image + 31.0, features).descriptors
        # a threshold inside a descriptor may tip over for single patches, not for more
        close = np.abs(a - b).max(axis=1) < 2e-3 * np.abs(a).max()
        assert close.mean() > 0.995

    def test_the_same_patch_elsewhere_has_the_same_descriptor(self, name):
        big = textured((272, 352))
        first, second = big[:240, :320], big[32:, 16:336]
        options = DetectorOptions(max_scale_px=3.0)
        a = detect("hessian-laplace", first, options)
        away = np.all((a.xy > [60, 80]) & (a.xy < [260, 180]), axis=1)
        a = replace(
            a,
            xy=a.xy[away],
            scale_px=a.scale_px[away],
            affine_shape=a.affine_shape[away],
            descriptors=a.descriptors[away],
        )
        b = replace(a, xy=a.xy - [16.0, 32.0])
        a, b = describe(name, first, a).descriptors, describe(name, second, b).descriptors
        assert len(a) > 30
        assert np.allclose(a, b, atol=0.02 * np.abs(a).max())

    def test_turned_images_match(self, name):
        from semsfm_colmap.matching.nearest import match_nearest

        image = textured((240, 240))
        a = extract("hessian-laplace", name, image)
        b = extract("hessian-laplace", name, np.rot90(image).copy())
        found = match_nearest(a.descriptors, b.descriptors, max_ratio=0.9).keypoints
        expected = np.column_stack([a.xy[:, 1], 240.0 - a.xy[:, 0]])[found[:, 0]]
        right = np.linalg.norm(b.xy[found[:, 1]] - expected, axis=1) < 1.0
        assert right.sum() > 0.5 * len(a.xy)
        assert right.mean() > 0.9

    def test_flat_surroundings_are_no_error(self, name):
        image = textured()
        features = detect("hessian-laplace", image)
        values = describe(name, np.full(image.shape, 77.0), features).descriptors
        assert np.all(np.isfinite(values))

    def test_no_features_give_no_descriptors_of_the_usual_length(self, name):
        image = textured()
        usual = extract("hessian-laplace", name, image).descriptors.shape[1]
        none = extract("hessian-laplace", name, np.zeros((60, 60))).descriptors
        assert none.shape == (0, usual)


def test_unknown_names_are_refused_with_the_list():
    with pytest.raises(UsageError, match="harris-laplace"):
        detect("harris-laplacian", textured())
    with pytest.raises(UsageError, match="rootsift"):
        extract("harris-laplace", "surf", textured())


def test_wrong_shapes_are_refused():
    with pytest.raises(UsageError, match="grey image"):
        detect("harris-laplace", np.zeros((10, 10, 3)))
    with pytest.raises(UsageError, match="mask"):
        detect("harris-laplace", np.zeros((10, 10)), mask=np.ones((10, 9), dtype=bool))
