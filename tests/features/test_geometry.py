"""Where regions lie and how big they are: disks of known radius, images under known warps."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from scipy.special import ive

from semsfm_colmap.features.affine import DERIVATIVE_SHARE
from semsfm_colmap.features.options import DetectorOptions
from semsfm_colmap.features.registry import detect, extract
from semsfm_colmap.features.scale_space import CAMERA_SIGMA
from tests.features.images import disk, textured, warp_image


def disk_scale(radius, blur):
    """Scale at which the normalised Laplacian is extremal at the centre of a blurred disk.

    There it is ``sigma^2 r^2 / t^2 exp(-r^2 / 2t)`` with t = sigma^2 + blur^2, extremal where
    ``t^2 - (s + 2 blur^2) t + s blur^2 = 0``, s = r^2 / 2; sigma = r / sqrt(2) without blur.
    """
    s = radius**2 / 2.0
    t = np.roots([1.0, -(s + 2.0 * blur**2), s * blur**2]).max()
    return np.sqrt(t - blur**2)


BLOBS = [
    "harris-laplace",
    "hessian-laplace",
    "harris-hessian-laplace",
    "harris-affine",
    "hessian-affine",
]
EVERYTHING = DetectorOptions(upright=True, max_num_features=0)


@pytest.mark.parametrize("name", BLOBS)
@pytest.mark.parametrize("radius", [6.0, 11.0, 20.0])
@pytest.mark.parametrize("contrast", [100.0, -60.0])
def test_a_blurred_disk_is_found_at_its_centre_and_scale(name, radius, contrast):
    centre, blur = np.array([90.3, 75.8]), 1.5
    image = disk((150, 180), centre, radius, blur, contrast=contrast)
    features = detect(name, image, EVERYTHING)
    expected = disk_scale(radius, np.sqrt(blur**2 - CAMERA_SIGMA**2))
    offset = np.linalg.norm(features.xy - centre, axis=1)
    near = np.flatnonzero(offset < 0.1 * radius)
    assert len(near) >= 1
    best = near[np.abs(np.log(features.scale_px[near] / expected)).argmin()]
    assert offset[best] < max(0.05, 0.02 * expected)
    assert features.scale_px[best] == pytest.approx(expected, rel=0.06)


@pytest.mark.parametrize("radius", [8.0, 14.0])
def test_edge_laplace_finds_the_rim_of_a_disk_at_the_scale_of_its_curvature(radius):
    centre, blur = np.array([90.3, 85.8]), 0.7
    image = disk((170, 180), centre, radius, blur)
    every_point = DetectorOptions(upright=True, max_num_features=0, merge_distance=0.0)
    features = detect("edge-laplace", image, every_point)
    # On the rim the disk smoothed by sigma is (1 - e^-u I0(u)) / 2 with u = r^2 / sigma^2, hence
    # its normalised Laplacian u e^-u (I0(u) - I1(u)), extremal, though flat, at one u.
    u = minimize_scalar(lambda v: -v * (ive(0, v) - ive(1, v)), bounds=(0.1, 5)).x
    on_rim = np.abs(np.linalg.norm(features.xy - centre, axis=1) - radius) < 0.5
    assert on_rim.sum() >= 20
    assert np.median(features.scale_px[on_rim]) == pytest.approx(radius / np.sqrt(u), rel=0.15)
    angle = np.arctan2(*(features.xy[on_rim] - centre).T)
    assert np.histogram(angle, 4, (-np.pi, np.pi))[0].min() > 0


@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.5, 0.25)])
def test_an_elliptic_blob_gets_its_ellipse(shift):
    matrix = np.array([[1.5, 0.3], [0.0, 0.75]])
    y, x = np.mgrid[:160, :160] + 0.5
    offset = np.stack([x - 80 - shift[0], y - 80 - shift[1]], -1) @ np.linalg.inv(matrix).T
    image = 100 + 80 * np.exp(-np.sum(offset**2, -1) / (2 * 6.0**2))
    features = detect("hessian-affine", image, EVERYTHING)
    nearest = np.linalg.norm(features.xy - 80 - shift, axis=1).argmin()
    assert np.linalg.norm(features.xy[nearest] - 80 - shift) < 0.1
    A = features.affine_shape[nearest]
    A = A / np.sqrt(np.linalg.det(A))
    # the blob as it is under the blur of the derivatives
    blur = DERIVATIVE_SHARE * features.scale_px[nearest]
    seen = 6.0**2 * matrix @ matrix.T + blur**2 * np.eye(2)
    assert np.allclose(A @ A.T, seen / np.sqrt(np.linalg.det(seen)), atol=0.08)
    # up stays up
    assert abs(A[0, 1]) < 1e-9


def repeatability(name, image, matrix, shift, options=EVERYTHING):
    """Share of features found again within 1.5 px, and their median distance."""
    from scipy.spatial import cKDTree

    warped = warp_image(image, matrix, shift, image.shape)
    a, b = detect(name, image, options), detect(name, warped, options)
    expected = a.xy @ matrix.T + shift
    inside = np.all((expected > 12) & (expected < np.array(image.shape[::-1]) - 12), axis=1)
    inside &= np.all((a.xy > 12) & (a.xy < np.array(image.shape[::-1]) - 12), axis=1)
    distance, _ = cKDTree(b.xy).query(expected[inside])
    found = distance < 1.5
    return found.mean(), np.median(distance[found])


def about_the_middle(matrix, shape):
    middle = np.array(shape[::-1]) / 2
    return matrix, middle - matrix @ middle


@pytest.mark.parametrize("name", [*BLOBS, "edge-laplace"])
@pytest.mark.parametrize(
    "warp", ["half a pixel", "5 degrees in the plane", "tilt to 0.87", "10 % larger"]
)
def test_features_are_found_again_under_known_warps(name, warp):
    image = textured()
    angle = np.radians(5.0)
    matrix = {
        "half a pixel": np.eye(2),
        "5 degrees in the plane": np.array(
            [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        ),
        "tilt to 0.87": np.diag([1.0, 0.87]),
        "10 % larger": 1.1 * np.eye(2),
    }[warp]
    matrix, shift = about_the_middle(matrix, image.shape)
    share, distance = repeatability(name, image, matrix, shift + 0.5)
    assert share > (0.7 if warp == "half a pixel" else 0.55)
    # an edge point slides along its edge
    assert distance < (0.7 if name == "edge-laplace" else 0.35)


def matches_under(detector, matrix):
    from semsfm_colmap.matching.nearest import match_nearest

    image = textured((300, 300), seed=3)
    matrix, shift = about_the_middle(matrix, image.shape)
    warped = warp_image(image, matrix, shift, image.shape)
    a = extract(detector, "sift", image, detection=EVERYTHING)
    b = extract(detector, "sift", warped, detection=EVERYTHING)
    rows = match_nearest(a.descriptors, b.descriptors, max_ratio=0.85).keypoints
    expected = a.xy[rows[:, 0]] @ matrix.T + shift
    return np.sum(np.linalg.norm(expected - b.xy[rows[:, 1]], axis=1) < 2.0)


def test_adapted_shapes_survive_a_strong_tilt_better_than_circles():
    tilt = np.array([[1.0, 0.25], [0.0, 0.5]])
    assert matches_under("hessian-affine", tilt) > 1.5 * matches_under("hessian-laplace", tilt)


def test_unions_merge_what_both_find():
    image = textured()
    both = detect("harris-laplace+hessian-laplace", image, EVERYTHING)
    one, other = (detect(n, image, EVERYTHING) for n in ("harris-laplace", "hessian-laplace"))
    same = detect("harris-hessian-laplace", image, EVERYTHING)
    assert np.array_equal(both.xy, same.xy)
    assert max(len(one.xy), len(other.xy)) < len(both.xy) < len(one.xy) + len(other.xy)
    assert set(np.unique(both.detector_id)) == {0, 1}
    twice = detect("harris-laplace+harris-laplace", image, EVERYTHING)
    assert np.array_equal(twice.xy, one.xy)


def test_a_doubled_image_finds_finer_features_at_the_same_places():
    from scipy.spatial import cKDTree

    image = textured()
    usual = detect("hessian-laplace", image, EVERYTHING)
    fine = detect(
        "hessian-laplace",
        image,
        DetectorOptions(upright=True, max_num_features=0, first_octave=-1),
    )
    assert fine.scale_px.min() < usual.scale_px.min()
    chosen = usual.scale_px > 2.5
    distance, _ = cKDTree(fine.xy).query(usual.xy[chosen])
    near = distance < 0.5
    assert near.mean() > 0.75
    # no half pixel lost between the sizes
    nearest = cKDTree(fine.xy).query(usual.xy[chosen][near])[1]
    bias = np.median(fine.xy[nearest] - usual.xy[chosen][near], axis=0)
    assert np.all(np.abs(bias) < 0.03)
