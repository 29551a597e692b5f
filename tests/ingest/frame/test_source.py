from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from semsfm_colmap.ingest.frame.source import scan_image
from semsfm_colmap.ingest.options import IngestOptions
from tests.ingest.images import save, texture, with_databar
from tests.ingest.prepared import assert_left_out, prepare


@pytest.mark.parametrize("value", [0, 255])
def test_a_black_or_white_frame_is_left_out(good: Path, value: int) -> None:
    save(good / "bad.png", np.full((160, 200), value, np.uint8))
    assert_left_out(prepare(good), "bad.png", f"every pixel has the value {value}")


def test_a_frame_that_is_black_above_its_databar_is_left_out(folder: Path) -> None:
    for i in range(3):
        save(folder / f"good{i}.png", with_databar(texture(i)))
    save(folder / "bad.png", with_databar(np.zeros((160, 200), np.uint8)))
    assert_left_out(prepare(folder), "bad.png", "the cropped image")


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_a_databar_at_the_top_or_at_a_side_is_said_with_its_crop(
    tmp_path: Path, turns: int
) -> None:
    side = {1: "right", 2: "top", 3: "left"}[turns]
    image = np.rot90(with_databar(texture(0)), turns)
    image_, _ = scan_image(save(tmp_path / "a.png", image.copy()), "a.png", IngestOptions())
    (warning,) = [w for w in image_.warnings if "databar" in w]
    assert f"at the {side}" in warning
    numbers = [int(word) for word in warning.split("--crop ")[1].split()[:4]]
    x0, y0, x1, y1 = numbers
    kept = np.rot90(np.arange(image.size).reshape(image.shape)[y0:y1, x0:x1], -turns)
    whole = np.rot90(np.arange(image.size).reshape(image.shape), -turns)
    np.testing.assert_array_equal(kept, whole[:136])
