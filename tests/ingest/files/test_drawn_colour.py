from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from semsfm_colmap.ingest.files.drawn_colour import drawn_colour
from semsfm_colmap.ingest.files.raster import read_header, read_pixels
from semsfm_colmap.ingest.masks.combine import grown
from tests.ingest.images import ANNOTATION, in_colour, save, texture


@pytest.mark.parametrize("colour", [(255, 230, 0), (0, 255, 0), (90, 20, 20), (60, 120, 255)])
def test_what_is_drawn_in_colour_is_found_in_one_image(colour: tuple[int, int, int]) -> None:
    found = drawn_colour(in_colour(texture(1), colour), lossy=False)
    assert found is not None
    np.testing.assert_array_equal(found, ANNOTATION)


@pytest.mark.parametrize("quality", [80, 95])
def test_colour_survives_jpeg(tmp_path: Path, quality: int) -> None:
    path = save(tmp_path / "a.jpg", in_colour(texture(1), (255, 0, 0)), quality=quality)
    found = read_pixels(path, read_header(path, 10**9)).coloured
    assert found is not None
    assert found[ANNOTATION].mean() > 0.6
    assert not found[~grown(grown(grown(ANNOTATION)))].any()


def test_photographs_tints_and_grey_have_nothing_drawn_in_colour() -> None:
    grey = np.repeat(texture(1)[..., None], 3, axis=2)
    assert drawn_colour(grey, lossy=False) is None
    assert drawn_colour(texture(1), lossy=False) is None
    rng = np.random.default_rng(0)
    photograph = np.clip(in_colour(texture(1)) + rng.integers(-3, 4, (160, 200, 3)), 0, 255)
    assert drawn_colour(photograph.astype(np.uint8), lossy=False) is None
    tinted = grey.astype(float)
    rows, columns = np.indices((160, 200))
    disc = (rows - 80) ** 2 + (columns - 90) ** 2 < 50**2  # coloured by hand
    tinted[disc] *= (1.0, 0.7, 0.3)
    assert drawn_colour(tinted.astype(np.uint8), lossy=False) is None
    false = np.stack([texture(1), 255 - texture(1), np.zeros_like(texture(1))], axis=2)
    assert drawn_colour(false, lossy=False) is None
