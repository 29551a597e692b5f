from __future__ import annotations

from pathlib import Path

from tests.ingest.images import save, texture
from tests.ingest.prepared import assert_left_out, prepare


def test_a_copy_of_another_frame_is_left_out(good: Path) -> None:
    save(good / "z.tif", texture(1))
    assert_left_out(prepare(good), "z.tif", "the pixels are those of good1.png")
