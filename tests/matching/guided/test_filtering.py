"""Filtered images are kept, within a budget."""

import numpy as np

from semsfm_colmap.matching.guided.filtering import FilteredImages, band_pass
from tests.matching.guided.test_align import SIZE, image


def test_filtered_images_are_made_once_and_dropped_from_the_oldest_on():
    read = []

    def read_image(i):
        read.append(i)
        return image() + i

    filtered = FilteredImages(read_image, max_bytes=2 * 4 * SIZE * SIZE)
    assert np.array_equal(filtered(0, 2.0), band_pass(image(), 2.0))
    for i, high_pass in ((0, 2.0), (1, 2.0), (0, 2.0), (0, 3.0)):
        filtered(i, high_pass)
    assert read == [0, 1, 0]  # each once, and once more for another high-pass
    filtered(0, 2.0)
    assert read == [0, 1, 0]
    filtered(1, 2.0)  # had to make way
    assert read == [0, 1, 0, 1]
