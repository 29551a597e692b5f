from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

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
