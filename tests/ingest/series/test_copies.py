from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from semsfm_colmap.ingest.inspect.inspection import inspect_images
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.ingest.prepare import prepare_series
from semsfm_colmap.types import SemSeries
from tests.ingest import vendor_files as vendor
from tests.ingest.images import save, texture, with_databar
from tests.ingest.prepared import prepare

OPTIONS = IngestOptions()


def with_header(path: Path, seed: int, image: np.ndarray | None = None) -> None:
    tag = vendor.fei(tilt_rad=0.1 * seed)
    pixels = with_databar(texture(seed)) if image is None else image
    vendor.write_tiff(path, pixels, {vendor.FEI_HELIOS: tag})


def clean(seed: int) -> np.ndarray:
    """A texture without the grain of its own."""
    import cv2

    smooth = cv2.GaussianBlur(np.array(texture(seed), order="C"), (0, 0), 3).astype(float)
    return np.asarray(128 + 2.5 * (smooth - smooth.mean()))


def noisy(image: np.ndarray, seed: int, sigma: float = 6.0) -> np.ndarray:
    noise = np.random.default_rng(seed).normal(scale=sigma, size=image.shape)
    return np.clip(np.rint(image + noise), 0, 255).astype(np.uint8)


def left_out(series: SemSeries) -> list[str]:
    return [w.split(":")[0] for w in series.warnings if w.endswith("Left out.")]


def test_of_equal_pixels_the_copy_with_the_header_is_kept(folder: Path, tmp_path: Path) -> None:
    for i in range(3):
        save(folder / f"f{i}.png", with_databar(texture(i)))  # comes first by its name
        with_header(folder / f"f{i}.tif", i)
    series = prepare(folder)
    assert series.names == ("f0.tif", "f1.tif", "f2.tif")
    assert series.pixel_size_um == pytest.approx(0.025)
    assert [f.metadata.tilt_rad for f in series.frames] == [0.0, 0.1, 0.2]
    assert left_out(series) == ["f0.png", "f1.png", "f2.png"]
    assert "f0.png: the pixels are those of f0.tif. Left out." in series.warnings
    rows = {row.name: row for row in inspect_images(folder, OPTIONS).rows}
    assert rows["f1.tif"].pixel_size_um == pytest.approx(0.025)
    assert rows["f1.png"].warnings[0] == "the pixels are those of f1.tif."


@pytest.mark.parametrize("quality", [60, 90])
def test_an_export_with_loss_is_one_view_with_its_original(folder: Path, quality: int) -> None:
    for i in range(3):
        save(folder / f"f{i}.jpg", texture(i), quality=quality)
        save(folder / f"f{i}.tif", texture(i))
    series = prepare(folder)
    assert series.names == ("f0.tif", "f1.tif", "f2.tif")
    assert "f0.jpg: the same view, noise included, as f0.tif. Left out." in series.warnings


def test_a_copy_of_other_brightness_under_another_name_is_found_too(good: Path) -> None:
    brighter = np.rint(0.9 * texture(1).astype(float) + 20).astype(np.uint8)
    save(good / "z.png", brighter)
    series = prepare(good)
    assert len(series.frames) == 3
    assert left_out(series) == ["z.png"]


@pytest.mark.parametrize("shift", [0.0, 0.4, 1.5])
def test_a_view_taken_again_is_kept_and_said(folder: Path, shift: float) -> None:
    import cv2

    for i in range(3):
        save(folder / f"{i}.png", noisy(clean(i), i))
    move = np.array([[1, 0, shift], [0, 1, 0.5 * shift]])
    again = cv2.warpAffine(clean(1), move, (200, 160), borderMode=cv2.BORDER_REFLECT)
    save(folder / "again.png", noisy(again, 17))
    series = prepare(folder)
    assert len(series.frames) == 4
    said = [w for w in series.warnings if "again: a frame more of the same view" in w]
    assert len(said) == 1
    assert "1.png" in said[0]
    assert "again.png" in said[0]
    assert said[0] in inspect_images(folder, OPTIONS).remarks


@pytest.mark.parametrize("stretch", [0.97, 0.98])
def test_a_specimen_that_turned_a_little_is_another_view(folder: Path, stretch: float) -> None:
    import cv2

    for i in range(3):
        move = np.array([[stretch**i, 0, 0], [0, 1, 0]], dtype=float)
        turned = cv2.warpAffine(clean(0), move, (200, 160), borderMode=cv2.BORDER_REFLECT)
        save(folder / f"{i}.png", noisy(turned, i))
    series = prepare(folder)
    assert len(series.frames) == 3
    assert not any("again" in warning for warning in series.warnings)


def turned_ball(image: np.ndarray, degrees: float) -> np.ndarray:
    """What covers a ball that fills the image, after a turn about the vertical axis."""
    import cv2

    height, width = image.shape
    y, x = np.mgrid[0:height, 0:width].astype(np.float32)
    radius2 = ((x - width / 2) / (width / 2)) ** 2 + ((y - height / 2) / (height / 2)) ** 2
    depth = 0.5 * width * np.sqrt(np.maximum(1.0 - radius2, 0.0))
    x += (np.sin(np.radians(degrees)) * depth).astype(np.float32)
    return np.asarray(cv2.remap(image, x, y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT))


@pytest.mark.parametrize("sigma", [6.0, 12.0])
def test_a_fine_step_about_an_axis_is_another_view_under_noise_too(
    folder: Path, sigma: float
) -> None:
    for i in range(4):
        save(folder / f"{i}.png", noisy(turned_ball(clean(0), 1.8 * i), i, sigma))
    assert not any("again" in warning for warning in prepare(folder).warnings)


def test_a_view_taken_again_under_other_charge_is_said(folder: Path) -> None:
    for i in range(3):
        save(folder / f"{i}.png", noisy(clean(i), i))
    y, x = np.mgrid[-1:1:160j, -1:1:200j]
    save(folder / "again.png", noisy(clean(1) * (0.9 + 0.1 * x - 0.05 * y), 17))
    said = [w for w in prepare(folder).warnings if "again: a frame more of the same view" in w]
    assert len(said) == 1
    assert "again.png" in said[0]


def test_an_export_without_the_databar_is_a_copy(folder: Path) -> None:
    for i in range(3):
        with_header(folder / f"f{i}.tif", i)
        save(folder / f"f{i}.jpg", with_databar(texture(i))[:136], quality=90)
    series = prepare_series(folder, folder.parent / "p", replace(OPTIONS))
    assert series.names == ("f0.tif", "f1.tif", "f2.tif")


def test_a_view_taken_again_is_said_where_its_databar_is_not_found(folder: Path) -> None:
    for i in range(3):
        save(folder / f"{i}.png", with_databar(noisy(clean(i), i)))
    # noise over the databar too: there is none to the eye of the program
    save(folder / "again.png", noisy(with_databar(noisy(clean(1), 17)).astype(float), 18))
    said = [w for w in prepare(folder).warnings if "again: a frame more of the same view" in w]
    assert len(said) == 1
    assert "1.png" in said[0]
    assert "again.png" in said[0]


def test_frames_of_another_format_are_not_compared(folder: Path) -> None:
    for i in range(3):
        save(folder / f"{i}.png", noisy(clean(i), i))
    save(folder / "strip.png", noisy(clean(1), 17)[:100])  # less than databars leave
    assert not any("again" in warning for warning in prepare(folder).warnings)
