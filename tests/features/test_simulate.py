import numpy as np
import pytest

from semsfm_colmap.errors import UsageError
from semsfm_colmap.features.options import DetectorOptions
from semsfm_colmap.features.registry import extract
from semsfm_colmap.features.simulate import (
    FRONTAL,
    View,
    extract_views,
    simulated_views,
    squeeze_image,
)
from semsfm_colmap.matching.nearest import match_nearest
from tests.features.images import disk, textured, warp_image

UPRIGHT = DetectorOptions(upright=True, max_num_features=0)


def test_directions_get_closer_with_the_tilt():
    views = simulated_views((2.0**0.5, 2.0))
    assert views[0] == FRONTAL
    assert sum(np.isclose(v.tilt, 2.0**0.5) for v in views) == 4
    assert sum(v.tilt == 2.0 for v in views) == 5
    with pytest.raises(UsageError, match="more than 1"):
        simulated_views((0.5,))


@pytest.mark.parametrize("view", [View(tilt=1.5, direction_rad=a) for a in (0.0, 0.7, np.pi / 2)])
def test_a_spot_comes_back_to_its_place_from_every_view(view):
    centre = np.array([70.3, 52.8])
    image = disk((110, 140), centre, 7.0, 1.5)
    squeezed, usable, matrix, shift = squeeze_image(image, None, view)
    assert np.linalg.det(matrix) == pytest.approx(1 / 1.5)
    # centre of brightness, where the map says
    weight = np.where(usable, squeezed - 90.0, 0.0)
    y, x = np.mgrid[: weight.shape[0], : weight.shape[1]]
    seen = np.array([(weight * x).sum(), (weight * y).sum()]) / weight.sum()
    assert np.allclose(seen, matrix @ (centre - 0.5) + shift, atol=0.05)
    features = extract_views("hessian-affine", "sift", image, [view], detection=UPRIGHT)
    nearest = np.linalg.norm(features.xy - centre, axis=1).argmin()
    assert np.linalg.norm(features.xy[nearest] - centre) < 0.15
    # the region of a round spot is round in the image although it was found squeezed
    A = features.affine_shape[nearest]
    values = np.linalg.svd(A, compute_uv=False)
    assert values[0] / values[1] < 1.35
    assert values.prod() == pytest.approx(features.scale_px[nearest] ** 2)


def test_what_lies_outside_the_image_or_its_mask_yields_nothing():
    image = textured((120, 160))
    mask = np.ones(image.shape, dtype=bool)
    mask[:, 100:] = False
    features = extract_views(
        "hessian-laplace", "sift", image, simulated_views(), detection=UPRIGHT, mask=mask
    )
    assert len(features.xy) > 100
    assert np.all((features.xy > 0) & (features.xy < [100.5, 120]))


def test_simulated_views_match_under_a_tilt_that_one_view_does_not_survive():
    image = textured((300, 300), seed=3)
    tilt = np.diag([1.0, 0.45])
    warped = warp_image(image, tilt, np.zeros(2), (135, 300))

    def right(a, b):
        rows = match_nearest(
            a.descriptors, b.descriptors, xy1=a.xy, xy2=b.xy, exclusion_px=2.0
        ).keypoints
        expected = a.xy[rows[:, 0]] @ tilt.T
        good = np.linalg.norm(expected - b.xy[rows[:, 1]], axis=1) < 2.0
        return good.sum(), good.mean()

    plain = [extract("hessian-laplace", "sift", i, detection=UPRIGHT) for i in (image, warped)]
    views = [FRONTAL, View(tilt=2.0, direction_rad=np.pi / 2)]
    simulated = [
        extract_views("hessian-laplace", "sift", i, views, detection=UPRIGHT)
        for i in (image, warped)
    ]
    few, many = right(*plain), right(*simulated)
    assert many[0] > 3 * few[0]
    assert many[1] > 0.8
