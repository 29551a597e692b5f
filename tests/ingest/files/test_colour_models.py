"""What a file means by its samples: inks, inverted scales, transparency; formats beside TIFF."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import tifffile
from PIL import Image

from tests.ingest.images import pixels_of, save, texture, written
from tests.ingest.prepared import prepare


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_inks_of_a_tiff_are_not_inverted(tmp_path: Path, kind: type) -> None:
    grey = texture(0).astype(kind)
    full = np.iinfo(kind).max
    black_ink = np.stack([*[np.zeros_like(grey)] * 3, full - grey], axis=-1)
    path = tmp_path / "k.tif"
    tifffile.imwrite(path, black_ink, photometric="separated")
    np.testing.assert_array_equal(pixels_of(path), grey)
    colours = np.stack([*[full - grey] * 3, np.zeros_like(grey)], axis=-1)
    tifffile.imwrite(path, colours, photometric="separated")
    np.testing.assert_array_equal(pixels_of(path), grey)


def test_inks_of_a_jpeg_are_not_inverted(tmp_path: Path) -> None:
    path = tmp_path / "a.jpg"
    Image.fromarray(texture(0)).convert("RGB").convert("CMYK").save(path, quality=100)
    assert np.corrcoef(pixels_of(path).ravel(), texture(0).ravel())[0, 1] > 0.99


@pytest.mark.parametrize("kind", [np.uint8, np.int8, np.uint16, np.int16, np.float32])
def test_white_as_zero_is_turned_over_whatever_the_type(tmp_path: Path, kind: type) -> None:
    grey = texture(0).astype(np.float64) - (128 if np.dtype(kind).kind == "i" else 0)
    path = tmp_path / "a.tif"
    tifffile.imwrite(path, grey.astype(kind), photometric="miniswhite")
    np.testing.assert_allclose(np.corrcoef(pixels_of(path).ravel(), grey.ravel())[0, 1], -1.0)


@pytest.mark.parametrize("suffix", ["png", "tif", "16.png", "palette.png", "webp"])
def test_what_is_transparent_is_masked(folder: Path, suffix: str) -> None:
    opaque = np.full((160, 200), 255, np.uint8)
    opaque[:, :40] = 0
    for i in range(3):
        path = folder / f"{i}.{suffix}"
        grey = texture(i)
        if suffix == "tif":
            tifffile.imwrite(
                path, np.stack([grey, opaque], axis=-1), photometric="minisblack",
                planarconfig="contig", extrasamples=["unassalpha"],
            )  # fmt: skip
        elif suffix == "16.png":
            import imagecodecs

            deep = np.stack([grey, opaque], axis=-1).astype(np.uint16) * 257
            path.write_bytes(imagecodecs.png_encode(deep))
        elif suffix == "palette.png":
            indexed = Image.fromarray(np.where(opaque > 0, np.maximum(grey, 1), 0).astype(np.uint8))
            indexed.convert("P").save(path, transparency=0)
        else:
            rgba = np.stack([grey, grey, grey, opaque], axis=-1)
            Image.fromarray(rgba).save(path, **({"lossless": True} if suffix == "webp" else {}))
    series = prepare(folder)
    project = folder.parent / "project"
    name = series.names[1]
    mask = written(project / f"masks/{name}.png")
    assert not mask[:, :40].any()
    assert mask[:, 40:].all()
    seen, grey = written(project / f"images/{name}")[:, 40:], texture(1)[:, 40:]
    assert np.corrcoef(seen.ravel(), grey.ravel())[0, 1] > 0.999
    assert any("what is transparent is masked" in warning for warning in series.warnings)


def test_an_opaque_image_with_alpha_has_no_mask(folder: Path) -> None:
    for i in range(3):
        rgba = np.stack([*[texture(i)] * 3, np.full((160, 200), 255, np.uint8)], axis=-1)
        Image.fromarray(rgba).save(folder / f"{i}.png")
    prepare(folder)
    assert not (folder.parent / "project/masks").exists()


def test_extra_samples_that_are_no_alpha_are_no_mask(folder: Path) -> None:
    for i in range(3):
        two = np.stack([texture(i), np.zeros((160, 200), np.uint8)], axis=-1)
        tifffile.imwrite(
            folder / f"{i}.tif", two, photometric="minisblack", planarconfig="contig",
            extrasamples=["unspecified"],
        )  # fmt: skip
    prepare(folder)
    assert not (folder.parent / "project/masks").exists()


@pytest.mark.parametrize("suffix", [".jp2", ".webp", ".gif"])
def test_other_formats_are_read_without_loss(folder: Path, suffix: str) -> None:
    for i in range(3):
        options = {".jp2": {"irreversible": False}, ".webp": {"lossless": True}}.get(suffix, {})
        save(folder / f"{i}{suffix}", texture(i), **options)
    series = prepare(folder)
    assert series.names == ("0.png", "1.png", "2.png")
    np.testing.assert_array_equal(written(folder.parent / "project/images/1.png"), texture(1))
