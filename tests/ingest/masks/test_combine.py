from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from semsfm_colmap.ingest.files.raster import read_header, read_pixels
from semsfm_colmap.ingest.masks.combine import grown
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.ingest.prepare import prepare_series
from tests.ingest.images import ANNOTATION, in_colour, save, stamped, texture
from tests.ingest.masks.scenes import before_static, disc, on_empty, read_mask


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


def test_burnt_in_writing_is_masked_and_said(folder: Path, tmp_path: Path) -> None:
    for i in range(5):
        save(folder / f"{i}.png", stamped(texture(i)))
    series = prepare_series(folder, tmp_path / "p", IngestOptions())
    masks = sorted(p.name for p in (tmp_path / "p/masks").iterdir())
    assert masks == [f"{i}.png.png" for i in range(5)]
    assert any("writing burnt into the images" in w for w in series.warnings)
    off = prepare_series(folder, tmp_path / "p", IngestOptions(masks="off"))
    assert list((tmp_path / "p/masks").iterdir()) == []
    assert not any("mask" in w for w in off.warnings)


def test_annotations_in_colour_are_masked_and_said(folder: Path, tmp_path: Path) -> None:
    for i in range(3):
        save(folder / f"{i}.png", in_colour(texture(i)) if i == 1 else texture(i))
    series = prepare_series(folder, tmp_path / "p", IngestOptions())
    (mask,) = (tmp_path / "p/masks").iterdir()
    assert mask.name == "1.png.png"
    raw = read_pixels(mask, read_header(mask, 10**9)).pixels
    np.testing.assert_array_equal(raw == 0, grown(ANNOTATION))
    assert "1.png: what is drawn in colour over the image is masked." in series.warnings
    prepare_series(folder, tmp_path / "q", IngestOptions(masks="off"))
    assert not (tmp_path / "q/masks").exists()
