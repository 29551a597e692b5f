from __future__ import annotations

import numpy as np
import pytest

from semsfm_colmap.geometry.pixel_noise import noise_level, quiet_noise_level


@pytest.mark.parametrize("sigma", [2.0, 6.0, 15.0])
def test_the_noise_level_is_that_of_the_noise(sigma: float) -> None:
    rng = np.random.default_rng(0)
    ramp = np.linspace(80, 160, 300)[None, :] * np.ones((300, 1))
    noisy = np.clip(np.rint(ramp + rng.normal(0, sigma, size=ramp.shape)), 0, 255)
    assert noise_level(noisy.astype(np.uint8)) == pytest.approx(sigma, rel=0.08)


def test_the_noise_of_an_image_with_some_flat_area_is_found() -> None:
    rng = np.random.default_rng(0)
    image = np.full((200, 200), 60.0, dtype=np.float32)
    image[:, 100:] += 50 * rng.random((200, 100))
    image += rng.normal(0, 3.0, image.shape)
    assert quiet_noise_level(image.astype(np.float32)) == pytest.approx(3.0, rel=0.15)
