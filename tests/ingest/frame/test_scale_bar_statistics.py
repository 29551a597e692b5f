"""Scale bars in drawn databars: none where there is none, no other length where there is one."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from semsfm_colmap.ingest.frame.scale_bar import find_bar_over_image, find_scale_bar
from tests.ingest.databars import KINDS, draw_databar
from tests.ingest.images import texture


def test_writing_alone_is_never_a_scale_bar() -> None:
    found = {
        seed: bar
        for seed in range(200)
        if (bar := find_scale_bar(draw_databar(np.random.default_rng(seed), None).pixels))
    }
    assert found == {}


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_bar_is_measured_to_a_percent_or_not_found(kind: str) -> None:
    missed = 0
    for seed in range(12):
        drawn = draw_databar(np.random.default_rng([seed, KINDS.index(kind)]), kind)
        bar = find_scale_bar(drawn.pixels)
        if bar is None:
            missed += 1
            continue
        assert bar.length_px == pytest.approx(drawn.length_px, rel=0.01)
        assert bar.has_marks == (kind != "plain")
    assert missed <= 1


@pytest.mark.parametrize("ink", [0, 255])
def test_a_bar_over_the_image_is_measured(ink: int) -> None:
    for seed in range(10):
        image = np.array(texture(seed, 240, 320), order="C")
        assert find_bar_over_image(image, None, lossy=False) is None
        length = 40 + 11 * seed
        image[200 : 202 + seed // 2, 20 : 20 + length] = ink
        cv2.putText(image, "10 um", (20, 194), 0, 0.5, ink, 1)
        bar = find_bar_over_image(image, None, lossy=False)
        assert bar is not None
        assert bar.length_px == length


def test_saturated_areas_are_no_bars() -> None:
    for seed in range(20):
        stretched = 4.0 * texture(seed, 240, 320).astype(float) - 330
        image = np.clip(stretched, 0, 255).astype(np.uint8)
        assert (image == 255).mean() > 0.05
        assert find_bar_over_image(image, None, lossy=False) is None


def test_a_bar_drawn_in_colour_is_measured() -> None:
    coloured = np.zeros((160, 200), bool)
    coloured[140:144, 20:120] = True
    bar = find_bar_over_image(texture(0), coloured, lossy=False)
    assert bar is not None
    assert bar.length_px == 100
