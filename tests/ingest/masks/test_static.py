from __future__ import annotations

import numpy as np
import pytest

from semsfm_colmap.ingest.masks.static import find_static
from tests.ingest.masks.scenes import before_static, disc, turning


def test_a_static_background_is_told_from_a_turning_specimen() -> None:
    scene = find_static([before_static(i) for i in range(12)])
    assert scene.masks is not None
    for mask in scene.masks:
        assert mask[disc(radius=64)].mean() > 0.99
        assert mask[~disc(radius=95)].mean() < 0.1


@pytest.mark.parametrize(
    ("frames", "reason"),
    [
        ([before_static(i) for i in range(4)], "6 frames"),
        ([before_static(i, moves=False) for i in range(8)], "moves too little"),
        ([turning(i) for i in range(8)], "nothing stands still"),
        ([np.full((240, 300), 90, np.uint8)] * 8, ""),
    ],
    ids=["few", "at rest", "all moves", "flat"],
)
def test_without_evidence_nothing_is_called_static(frames: list[np.ndarray], reason: str) -> None:
    scene = find_static(frames)
    assert scene.masks is None
    assert reason in scene.reason


def test_a_tilt_there_and_back_does_not_make_the_specimen_static() -> None:
    order = [0, 1, 2, 3, 2, 1, 0, 1, 2, 3, 2, 1]
    scene = find_static([turning(i)[:, :300] for i in order])
    assert scene.masks is None
