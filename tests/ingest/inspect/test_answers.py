from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from semsfm_colmap.ingest.inspect.inspection import inspect_images
from tests.ingest import vendor_files as vendor
from tests.ingest.images import save, texture, with_databar
from tests.ingest.inspect.views import HEIGHT, OPTIONS, TILTS, WIDTH, answer, view, write_series


def test_a_change_of_magnification_is_found_in_the_images(folder: Path) -> None:
    images = [view(t, i) for i, t in enumerate(TILTS)]
    zoom = cv2.getRotationMatrix2D((WIDTH / 2, HEIGHT / 2), 0, 1.15)
    for i in (4, 5, 6):
        images[i] = cv2.warpAffine(images[i], zoom, (WIDTH, HEIGHT))
    write_series(folder, images)
    inspection = inspect_images(folder, OPTIONS)
    assert answer(inspection, "same magnification") == "no"
    (reason,) = (a.reason for a in inspection.answers if a.question == "same magnification")
    assert reason.startswith("4.png")


def test_a_flat_specimen_shows_no_depth(folder: Path) -> None:
    write_series(folder, [view(t, i, depth=0.0) for i, t in enumerate(TILTS)])
    inspection = inspect_images(folder, OPTIONS)
    assert answer(inspection, "overlapping") == "yes"
    assert answer(inspection, "enough tilt") == "no"


@pytest.mark.parametrize(
    ("step", "count", "expected"), [(0.5, 4, "no"), (3.0, 4, "just"), (5.0, 5, "yes")]
)
def test_recorded_tilts_decide_whether_there_is_enough(
    folder: Path, step: float, count: int, expected: str
) -> None:
    for i in range(count):
        tag = vendor.fei(tilt_rad=np.radians(step * i))
        vendor.write_tiff(folder / f"{i}.tif", with_databar(texture(i)), {vendor.FEI_HELIOS: tag})
    assert answer(inspect_images(folder, OPTIONS), "enough tilt") == expected


@pytest.mark.parametrize(("count", "expected"), [(1, "no"), (2, "no"), (3, "just"), (5, "yes")])
def test_the_number_of_images_is_judged(folder: Path, count: int, expected: str) -> None:
    write_series(folder, [texture(i) for i in range(count)])
    assert answer(inspect_images(folder, OPTIONS), "enough images") == expected


def test_tilts_that_only_some_images_record_are_judged_by_these(folder: Path) -> None:
    for i in range(5):
        tag = vendor.fei(tilt_rad=np.radians(5.0 * i))
        vendor.write_tiff(folder / f"{i}.tif", with_databar(texture(i)), {vendor.FEI_HELIOS: tag})
    save(folder / "5.png", with_databar(texture(5)))
    (found,) = (a for a in inspect_images(folder, OPTIONS).answers if a.question == "enough tilt")
    assert found.answer == "yes"
    assert found.reason == (
        "20.0 degrees between the 5 images that record it in steps of up to 5.0"
    )
