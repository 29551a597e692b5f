"""COLMAP's keypoints as regions, alone and in unions with our detectors."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from semsfm_colmap.colmap.sift_features import VARIANTS, sift_features
from semsfm_colmap.errors import UsageError
from semsfm_colmap.features.external import external_regions
from semsfm_colmap.features.options import DetectorOptions
from semsfm_colmap.features.regions import regions_from_frames
from semsfm_colmap.features.registry import EXTERNAL, describe, detect, prepare
from tests.features.images import disk, textured
from tests.features.test_geometry import disk_scale

UPRIGHT = DetectorOptions(upright=True, max_num_features=0)


def regions_in(folder, image, union):
    """What COLMAP finds in one image, written as a file for it."""
    (folder / "images").mkdir(exist_ok=True)
    pixels = np.clip(np.rint(image), 0, 255).astype(np.uint8)
    cv2.imwrite(str(folder / "images" / "one.png"), pixels)
    size = [(image.shape[1], image.shape[0])]

    def find(detector):
        return sift_features(detector, folder / "images", ["one.png"], size, upright=True)

    return external_regions(union, 1, find)[0]


def test_every_external_detector_has_its_options():
    assert set(VARIANTS) == set(EXTERNAL)


@pytest.mark.parametrize("name", EXTERNAL)
@pytest.mark.parametrize("radius", [6.0, 11.0])
def test_a_blurred_disk_is_found_at_its_centre_and_scale(tmp_path, name, radius):
    centre, blur = np.array([90.3, 75.8]), 1.5
    image = disk((150, 180), centre, radius, blur)
    regions = regions_in(tmp_path, image, name)[name]
    offset = np.linalg.norm(regions.xy + 0.5 - centre, axis=1)
    best = np.argmin(offset + np.abs(np.log(regions.scale_px / disk_scale(radius, blur))))
    assert offset[best] < 0.1
    # a difference of Gaussians, not the Laplacian itself, and steps of a third of an octave
    assert regions.scale_px[best] == pytest.approx(disk_scale(radius, blur), rel=0.15)


@pytest.mark.parametrize("name", EXTERNAL)
def test_its_regions_are_described_like_ours(tmp_path, name):
    image = textured()
    external = regions_in(tmp_path, image, name)
    prepared = prepare(image)
    features = describe("rootsift", prepared, detect(name, prepared, UPRIGHT, external=external))
    assert len(features.xy) > 200
    assert features.descriptors.shape == (len(features.xy), 128)
    assert np.allclose(np.linalg.det(features.affine_shape), features.scale_px**2)
    assert set(features.detector_id) == {EXTERNAL[name]}


def test_a_union_holds_both_and_merges_near_duplicates(tmp_path):
    image = textured()
    union = "hessian-laplace+colmap-sift"
    external = regions_in(tmp_path, image, union)
    prepared = prepare(image)
    ours = detect("hessian-laplace", prepared, UPRIGHT)
    both = detect(union, prepared, UPRIGHT, external=external)
    theirs = detect("colmap-sift", prepared, UPRIGHT, external=external)
    assert set(both.detector_id) == {1, EXTERNAL["colmap-sift"]}
    assert max(len(ours.xy), len(theirs.xy)) < len(both.xy) < len(ours.xy) + len(theirs.xy)


def test_masked_places_have_no_regions(tmp_path):
    image = textured()
    mask = np.ones(image.shape, dtype=bool)
    mask[:, 200:] = False
    external = regions_in(tmp_path, image, "colmap-sift")
    features = detect("colmap-sift", image, UPRIGHT, mask, external=external)
    assert len(features.xy) > 50
    assert np.all(features.xy[:, 0] + features.scale_px <= 201.0)


def test_without_its_regions_the_detector_is_refused():
    with pytest.raises(UsageError, match="colmap-sift is a detector of COLMAP"):
        detect("harris-laplace+colmap-sift", textured())


def test_the_plain_variant_is_what_colmap_finds(tmp_path):
    image = textured()
    regions = regions_in(tmp_path, image, "colmap-sift")["colmap-sift"]
    found = sift_features(
        "colmap-sift", tmp_path / "images", ["one.png"], [(320, 240)], upright=True
    )[0]
    np.testing.assert_allclose(regions.xy + 0.5, found.xy)
    np.testing.assert_allclose(regions.scale_px, found.scale_px, rtol=1e-6)
    assert found.descriptors.shape == (len(found.xy), 128)


def test_a_region_keeps_the_ellipse_of_a_frame_and_not_its_turn():
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])
    symmetric = np.array([[3.0, 1.0], [1.0, 2.0]])
    regions = regions_from_frames(
        np.zeros((1, 2)), (symmetric @ turn)[None], np.ones(1), detector_id=7
    )
    np.testing.assert_allclose(regions.scale_px, np.sqrt(5.0))
    np.testing.assert_allclose(regions.shape[0] * regions.scale_px, symmetric, atol=1e-12)
