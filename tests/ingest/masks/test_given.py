from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from semsfm_colmap.errors import UsageError
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.ingest.prepare import prepare_series
from tests.ingest.images import save, texture, with_databar, written
from tests.ingest.masks.scenes import disc, on_empty

OPTIONS = IngestOptions()


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


def test_given_masks_are_cut_like_their_images(folder: Path, tmp_path: Path) -> None:
    mask = np.zeros((160, 200), np.uint8)
    mask[30:100, 40:90] = 255
    for i in range(3):
        save(folder / f"{i}.tif", with_databar(texture(i)))
    save(folder / "masks/1.tif.png", mask)
    series = prepare_series(folder, tmp_path / "p", OPTIONS)
    assert len(series.frames) == 3
    np.testing.assert_array_equal(written(tmp_path / "p/masks/1.tif.png"), mask[:136])
    assert [p.name for p in (tmp_path / "p/masks").iterdir()] == ["1.tif.png"]
