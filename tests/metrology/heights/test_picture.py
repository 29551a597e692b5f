import io

import numpy as np
import pytest
from PIL import Image

from semsfm_colmap.metrology.heights.picture import height_map_picture, round_length
from tests.metrology.heights.surfaces import a_map, rough


def test_a_picture_shows_holes_in_their_colour_and_has_a_size():
    z = rough(80, 90, 8.0, 1.0, seed=1)
    z[20:60, 20:60] = np.nan
    content = height_map_picture(a_map(z, sigma=0.1), a_map(z, sigma=0.1), "a title")
    with Image.open(io.BytesIO(content)) as image:
        assert image.width > 1000
        pixels = np.asarray(image.convert("RGB")).reshape(-1, 3)
    hole = np.all(pixels == [0xE2, 0xE8, 0xF0], axis=1).mean()
    # a hole of a fifth of each of three maps
    assert hole > 0.05


def test_a_map_without_error_bars_has_a_picture():
    z = rough(40, 40, 8.0, 1.0, seed=1)
    assert height_map_picture(a_map(z), a_map(z), "a title").startswith(b"\x89PNG")


@pytest.mark.parametrize(("most", "length"), [(1.0, 1.0), (0.99, 0.5), (37.0, 20.0), (0.05, 0.05)])
def test_scale_bars_have_round_lengths(most, length):
    assert round_length(most) == pytest.approx(length)
