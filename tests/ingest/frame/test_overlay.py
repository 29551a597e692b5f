from __future__ import annotations

import numpy as np

from semsfm_colmap.ingest.frame.overlay import ConstantPixels, find_overlay
from tests.ingest.images import stamped, texture


def constant(images: list[np.ndarray], *, lossy: bool = False) -> ConstantPixels:
    frames = ConstantPixels()
    for image in images:
        frames.add(image, lossy=lossy)
    return frames


def test_burnt_in_writing_is_found_where_it_is() -> None:
    overlay = find_overlay(constant([stamped(texture(i)) for i in range(6)]))
    assert overlay is not None
    drawn = stamped(np.zeros((160, 200), np.uint8)) > 0
    assert overlay.writing[drawn].all()
    grown = np.zeros_like(drawn)
    grown[12:50, 5:85] = True
    assert not overlay.writing[~grown].any()
    assert overlay.databar_row is None


def test_no_writing_is_invented() -> None:
    assert find_overlay(constant([texture(i) for i in range(6)])) is None


def test_saturated_and_clipped_areas_are_no_writing() -> None:
    rows, columns = np.indices((160, 200))
    glow = 260 * np.exp(-((rows - 50) ** 2 + (columns - 60) ** 2) / 800.0)
    images = [
        np.clip(texture(i).astype(float) - 60 + glow, 0, 255).astype(np.uint8) for i in range(6)
    ]
    assert (np.min(images, axis=0) == 255).sum() > 50  # constant over the frames
    assert find_overlay(constant(images)) is None


def test_copies_of_one_frame_tell_nothing() -> None:
    assert find_overlay(constant([stamped(texture(0))] * 6)) is None


def test_few_frames_tell_nothing() -> None:
    assert find_overlay(constant([stamped(texture(i)) for i in range(3)])) is None
