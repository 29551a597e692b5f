from __future__ import annotations

import cv2
import numpy as np
import pytest

from semsfm_colmap.ingest.frame.quality import judge, measure
from tests.ingest.inspect.views import view


def test_sharpness_does_not_depend_on_noise_or_contrast() -> None:
    base = view(0, 0).astype(float)
    reference = measure(base.astype(np.uint8)).sharpness
    noisy = base + np.random.default_rng(1).normal(0, 8, size=base.shape)
    faint = 120 + 0.5 * (base - 120)
    for image in (noisy, faint):
        again = measure(np.clip(image, 0, 255).astype(np.uint8)).sharpness
        assert again == pytest.approx(reference, rel=0.25)
    blurred = measure(cv2.GaussianBlur(view(0, 0), (0, 0), 1.5)).sharpness
    assert blurred < 0.5 * reference


def test_a_single_frame_is_not_judged_against_nothing() -> None:
    assert judge([measure(view(0))]) == ([],)
    assert judge([]) == ()
