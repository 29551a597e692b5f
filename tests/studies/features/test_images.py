import cv2
import numpy as np
import pytest

from semsfm_colmap.features.options import DetectorOptions
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.studies.features.images import load_images
from semsfm_colmap.studies.features.options import CompareOptions, StudyOptions
from semsfm_colmap.studies.features.study import run_study
from tests.features.images import textured


@pytest.mark.parametrize("name", ["plain", "ä b 花", "100%d [1]"])
def test_the_names_of_folders_and_images_do_not_matter(tmp_path, name):
    source, folder = tmp_path / name / "images", tmp_path / f"{name} prepared"
    source.mkdir(parents=True)
    folder.mkdir()
    rng = np.random.default_rng(0)
    noisy = [np.roll(textured(), k, axis=1) + rng.normal(0, 4, (240, 320)) for k in range(3)]
    pixels = [np.clip(image, 0, 255).astype(np.uint8) for image in noisy]
    for k, image in enumerate(pixels):
        (source / f"{name} {k}.png").write_bytes(cv2.imencode(".png", image)[1].tobytes())
    options = CompareOptions(
        study=StudyOptions(detectors=("hessian-laplace", "colmap-sift"), descriptors=("sift",)),
        detection=DetectorOptions(max_num_features=200),
    )
    images = load_images(source, folder, options, IngestOptions())
    assert images.series == name
    assert images.names == tuple(f"{name} {k}.png" for k in range(3))
    for ours, image in zip(images.pixels, pixels, strict=True):
        np.testing.assert_array_equal(ours, image)
    counts = run_study(images, options).counts
    assert all(count.matched > 50 for count in counts)
