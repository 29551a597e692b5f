from __future__ import annotations

import numpy as np
import pytest

from semsfm_colmap.ingest.files.raster import read_header, read_pixels
from semsfm_colmap.ingest.masks.foreground import find_foreground, texture_kept
from tests.conftest import DATA
from tests.ingest.images import texture
from tests.ingest.masks.scenes import COLUMNS, disc, on_empty


@pytest.mark.parametrize("level", [10.0, 60.0, 200.0])
def test_a_specimen_on_an_empty_background_is_found_whole(level: float) -> None:
    image = on_empty(1, level=level)
    found = find_foreground(image)
    assert found.mask is not None
    assert found.mask[disc()].mean() > 0.999  # never cuts the specimen
    assert found.mask[~disc(radius=90)].mean() < 0.02
    assert texture_kept(image, found.mask) > 0.99


def test_a_field_that_fills_the_frame_gets_no_mask() -> None:
    found = find_foreground(texture(1, 240, 300))
    assert found.mask is None
    assert found.reason


def test_an_empty_frame_gets_no_mask() -> None:
    noise = np.random.default_rng(0).normal(40, 4, size=(240, 300)).astype(np.uint8)
    assert find_foreground(noise).mask is None


def test_the_texture_kept_is_the_share_of_it_inside() -> None:
    image = on_empty(1)
    assert texture_kept(image, np.ones_like(image, dtype=bool)) == pytest.approx(1.0)
    assert texture_kept(image, np.zeros_like(image, dtype=bool)) == 0.0
    half = COLUMNS < 150
    assert 0.4 < texture_kept(image, half) < 0.6


@pytest.mark.data
@pytest.mark.skipif(not DATA.is_dir(), reason="needs the development data")
@pytest.mark.parametrize(
    ("name", "has_mask"),
    [
        ("synth_pollen/images/pollen_016.png", True),
        ("synth_spore/images/spore_024.png", True),
        ("sem_quartz3/Quarz_02.png", True),
        ("synth_nickel/images/nickel_004.png", False),
        ("sem_metadata/quanta_image.tif", False),
    ],
)
def test_real_and_rendered_specimens_keep_their_texture(name: str, has_mask: bool) -> None:
    pixels = read_pixels(DATA / name, read_header(DATA / name, 10**9)).pixels
    rows = 708 if "synth" in name else 884 if "quanta" in name else None
    found = find_foreground(pixels[:rows])
    assert (found.mask is not None) == has_mask
    if found.mask is not None:
        assert texture_kept(pixels[:rows], found.mask) > 0.999
        assert found.mask.mean() < 0.7
