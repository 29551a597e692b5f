from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from semsfm_colmap.errors import UsageError
from semsfm_colmap.ingest.files.raster import read_header, read_pixels
from semsfm_colmap.ingest.masks.foreground import find_foreground, texture_kept
from semsfm_colmap.ingest.masks.static import find_static
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.ingest.prepare import prepare_series
from tests.ingest.conftest import DATA, save, texture

ROWS, COLUMNS = np.indices((240, 300))


def disc(column: float = 150.0, radius: float = 70.0) -> np.ndarray:
    return (ROWS - 120.0) ** 2 + (COLUMNS - column) ** 2 < radius**2


def on_empty(seed: int, *, level: float = 25.0, column: float = 150.0) -> np.ndarray:
    """A textured disc on a background of noise."""
    rng = np.random.default_rng(seed + 1000)
    noise = rng.normal(level, 3.0, size=(240, 300))
    image = np.where(disc(column), texture(seed, 240, 300), noise)
    return np.clip(image, 0, 255).astype(np.uint8)


@pytest.mark.parametrize("level", [10.0, 60.0, 200.0])
def test_a_specimen_on_an_empty_background_is_found_whole(level: float) -> None:
    image = on_empty(1, level=level)
    found = find_foreground(image)
    assert found.mask is not None
    assert found.mask[disc()].mean() > 0.999  # never cuts the specimen
    assert found.mask[~disc(radius=90)].mean() < 0.02
    assert texture_kept(image, found.mask) > 0.99


def test_a_field_that_fills_the_frame_gets_no_mask() -> None:
    found = find_foreground(texture(1, 240, 300))
    assert found.mask is None
    assert found.reason


def test_an_empty_frame_gets_no_mask() -> None:
    noise = np.random.default_rng(0).normal(40, 4, size=(240, 300)).astype(np.uint8)
    assert find_foreground(noise).mask is None


def test_the_texture_kept_is_the_share_of_it_inside() -> None:
    image = on_empty(1)
    assert texture_kept(image, np.ones_like(image, dtype=bool)) == pytest.approx(1.0)
    assert texture_kept(image, np.zeros_like(image, dtype=bool)) == 0.0
    half = COLUMNS < 150
    assert 0.4 < texture_kept(image, half) < 0.6


def turning(i: int, count: int = 12) -> np.ndarray:
    """A disc whose texture moves across it, as the face of a turning body does."""
    wide = texture(5, 240, 300 + 20 * count)
    return wide[:, 20 * i : 20 * i + 300]


def before_static(i: int, *, moves: bool = True) -> np.ndarray:
    rng = np.random.default_rng(i)
    scene = texture(99, 240, 300).astype(float)
    specimen = turning(i if moves else 0).astype(float)
    image = np.where(disc(), specimen, scene) + rng.normal(0, 4, size=(240, 300))
    return np.clip(image, 0, 255).astype(np.uint8)


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


def read_mask(path: Path) -> np.ndarray:
    return np.asarray(Image.open(path)) > 0


def test_automatic_masks_are_written_and_their_effect_is_said(folder: Path, tmp_path: Path) -> None:
    for i in range(3):
        save(folder / f"{i}.png", on_empty(i))
    series = prepare_series(folder, tmp_path / "p", IngestOptions(masks="foreground"))
    for i in range(3):
        mask = read_mask(tmp_path / f"p/masks/{i}.png.png")
        assert mask[disc()].mean() > 0.999
        assert mask.mean() < 0.5
    (said,) = (w for w in series.warnings if w.startswith("masks leave out"))
    assert "of the area of 3 images" in said
    effect = json.loads((tmp_path / "p/series.json").read_text())["preparation"]["mask_effect"]
    assert set(effect) == {"0.png", "1.png", "2.png"}
    assert effect["0.png"][0] == pytest.approx(1 - read_mask(tmp_path / "p/masks/0.png.png").mean())
    assert effect["0.png"][1] < 0.02


def test_where_no_automatic_mask_is_possible_it_is_said(folder: Path, tmp_path: Path) -> None:
    for i in range(3):
        save(folder / f"{i}.png", texture(i, 240, 300))
    series = prepare_series(folder, tmp_path / "p", IngestOptions(masks="foreground"))
    assert not (tmp_path / "p/masks").exists()
    assert any("no automatic mask" in w for w in series.warnings)


def test_masks_from_motion_are_written(folder: Path, tmp_path: Path) -> None:
    for i in range(10):
        save(folder / f"{i}.png", before_static(i))
    prepare_series(folder, tmp_path / "p", IngestOptions(masks="motion"))
    mask = read_mask(tmp_path / "p/masks/4.png.png")
    assert mask[disc(radius=64)].mean() > 0.99
    assert mask[~disc(radius=95)].mean() < 0.1


def test_a_given_mask_wins_over_the_automatic_one(folder: Path, tmp_path: Path) -> None:
    for i in range(3):
        save(folder / f"{i}.png", on_empty(i))
    given = np.full((240, 300), 255, np.uint8)
    given[:, :20] = 0
    save(folder / "masks/1.png.png", given)
    prepare_series(folder, tmp_path / "p", IngestOptions(masks="auto"))
    np.testing.assert_array_equal(read_mask(tmp_path / "p/masks/1.png.png"), given > 0)


def test_a_mask_that_takes_the_specimen_away_is_pointed_out(folder: Path, tmp_path: Path) -> None:
    for i in range(3):
        save(folder / f"{i}.png", on_empty(i))
    save(folder / "masks/1.png.png", np.where(disc(), 0, 255).astype(np.uint8))
    series = prepare_series(folder, tmp_path / "p", IngestOptions())
    assert any(w.startswith("1.png: the mask takes away more than") for w in series.warnings)


@pytest.mark.parametrize(
    ("mask", "reason"),
    [
        (np.zeros((240, 300), np.uint8), "would leave nothing"),
        (np.full((24, 30), 255, np.uint8), "has 30 x 24 pixels but the image 300 x 240"),
    ],
    ids=["empty", "size"],
)
def test_a_mask_that_does_not_fit_is_not_used(
    folder: Path, tmp_path: Path, mask: np.ndarray, reason: str
) -> None:
    for i in range(3):
        save(folder / f"{i}.png", on_empty(i))
    save(folder / "masks/1.png.png", mask)
    series = prepare_series(folder, tmp_path / "p", IngestOptions())
    assert reason in series.frames[1].warnings[0]
    assert not (tmp_path / "p/masks").exists()


def test_masks_are_found_beside_the_image_folder_and_where_told(
    folder: Path, tmp_path: Path
) -> None:
    for i in range(3):
        save(folder / f"{i}.tif", on_empty(i))
    mask = disc().astype(np.uint8) * 255
    save(folder.parent / "masks/1.tif.png", mask)
    prepare_series(folder, tmp_path / "p", IngestOptions())
    assert (tmp_path / "p/masks/1.tif.png").exists()
    save(tmp_path / "elsewhere/2.png", mask)  # named without the suffix of the image
    options = IngestOptions(masks_path=tmp_path / "elsewhere")
    prepare_series(folder, tmp_path / "p", options)
    assert [p.name for p in (tmp_path / "p/masks").iterdir()] == ["2.tif.png"]
    with pytest.raises(UsageError, match="is not a folder"):
        prepare_series(folder, tmp_path / "p", IngestOptions(masks_path=tmp_path / "none"))


@pytest.mark.data
@pytest.mark.skipif(not DATA.is_dir(), reason="needs the development data")
@pytest.mark.parametrize(
    ("name", "has_mask"),
    [
        ("synth_pollen/images/pollen_016.png", True),
        ("synth_spore/images/spore_024.png", True),
        ("sem_quartz3/Quarz_02.png", True),
        ("synth_nickel/images/nickel_004.png", False),
        ("sem_metadata/quanta_image.tif", False),
    ],
)
def test_real_and_rendered_specimens_keep_their_texture(name: str, has_mask: bool) -> None:
    pixels = read_pixels(DATA / name, read_header(DATA / name, 10**9)).pixels
    rows = 708 if "synth" in name else 884 if "quanta" in name else None
    found = find_foreground(pixels[:rows])
    assert (found.mask is not None) == has_mask
    if found.mask is not None:
        assert texture_kept(pixels[:rows], found.mask) > 0.999
        assert found.mask.mean() < 0.7
