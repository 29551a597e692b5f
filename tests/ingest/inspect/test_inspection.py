from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from semsfm_colmap.errors import InputError
from semsfm_colmap.ingest.inspect.inspection import inspect_images
from tests.conftest import DATA
from tests.ingest.images import save, texture, with_databar
from tests.ingest.inspect.views import (
    HEIGHT,
    OPTIONS,
    TILTS,
    WIDTH,
    answer,
    view,
    warned,
    write_series,
)


def test_a_good_series_gets_yes_throughout(folder: Path) -> None:
    write_series(folder, [view(t, i) for i, t in enumerate(TILTS)])
    inspection = inspect_images(folder, OPTIONS)
    # parallax shows depth, but not how far the specimen was turned
    assert [a.answer for a in inspection.answers] == ["yes", "yes", "unknown", "yes", "yes"]
    assert all(row.warnings == ("no microscope header",) for row in inspection.rows)


def test_blurred_charged_and_foreign_frames_are_found(folder: Path) -> None:
    images = [view(t, i) for i, t in enumerate(TILTS)]
    rng = np.random.default_rng(5)
    blurred = cv2.GaussianBlur(images[1].astype(np.float32), (0, 0), 2.0)
    images[1] = np.clip(blurred + rng.normal(0, 5, blurred.shape), 0, 255).astype(np.uint8)
    charged = images[3].astype(float)
    charged[100:112] += 60
    charged[250:255] -= 50
    images[3] = np.clip(charged, 0, 255).astype(np.uint8)
    images[5] = texture(77, HEIGHT, WIDTH)
    write_series(folder, images)
    inspection = inspect_images(folder, OPTIONS)
    assert warned(inspection, "blurred") == ["1.png"]
    assert warned(inspection, "charged") == ["3.png"]
    assert warned(inspection, "shares no features") == ["5.png"]
    assert answer(inspection, "frames in order") == "no"
    assert answer(inspection, "overlapping") == "partly"


def test_without_a_usable_image_nothing_is_called_in_order(folder: Path) -> None:
    save(folder / "0.png", np.zeros((160, 200), np.uint8))
    inspection = inspect_images(folder, OPTIONS)
    assert answer(inspection, "frames in order") == "unknown"
    assert answer(inspection, "enough images") == "no"


def test_an_empty_folder_is_an_input_error(folder: Path) -> None:
    with pytest.raises(InputError, match="no images in"):
        inspect_images(folder, OPTIONS)


def test_frames_that_are_no_neighbours_are_not_compared(folder: Path) -> None:
    images = [texture(i) for i in range(5)]
    images[2] = (images[2] // 4).astype(np.uint8)
    write_series(folder, images)
    assert warned(inspect_images(folder, OPTIONS), "brightness") == []


def test_a_frame_with_nothing_above_its_databar_is_not_usable(folder: Path) -> None:
    write_series(folder, [with_databar(texture(i)) for i in range(3)])
    save(folder / "x.png", with_databar(np.zeros((160, 200), np.uint8)))
    inspection = inspect_images(folder, OPTIONS)
    assert inspection.rows[-1].warnings[0].startswith("every pixel of the cropped image")
    assert (
        "3 usable" in inspection.answers[0].reason or "3 determine" in inspection.answers[0].reason
    )


def test_a_stranger_does_not_spoil_the_judgement_of_its_neighbours(folder: Path) -> None:
    images = [view(t, i) for i, t in enumerate(TILTS)]
    images[3] = (texture(77, HEIGHT, WIDTH) // 6).astype(np.uint8)
    write_series(folder, images)
    inspection = inspect_images(folder, OPTIONS)
    assert warned(inspection, "shares no features") == ["3.png"]
    assert warned(inspection, "brightness") == []


def test_progress_is_told(folder: Path) -> None:
    write_series(folder, [texture(i) for i in range(3)])
    seen: list[tuple[int, int]] = []
    inspect_images(folder, OPTIONS, progress=lambda n, m: seen.append((n, m)))
    assert seen == [(1, 3), (2, 3), (3, 3)]


@pytest.mark.data
@pytest.mark.skipif(not DATA.is_dir(), reason="needs the development data")
@pytest.mark.parametrize("name", ["sem_pot1", "synth_nickel/images"])
def test_real_and_rendered_series_are_found_in_order(name: str) -> None:
    inspection = inspect_images(DATA / name, OPTIONS)
    assert answer(inspection, "overlapping") == "yes"
    assert answer(inspection, "enough tilt") == "unknown"  # none is recorded
    assert answer(inspection, "frames in order") == "yes"
