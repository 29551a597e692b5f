from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.ingest.prepare import prepare_series
from semsfm_colmap.ingest.series.file import read_series, write_series
from semsfm_colmap.types import SemFrame, SemMetadata, SemSeries
from tests.ingest.conftest import DATA, save, texture, with_databar

OPTIONS = IngestOptions()


def pixels(path: Path) -> np.ndarray:
    if path.suffix.lower() in (".tif", ".tiff"):
        import tifffile

        return tifffile.imread(path)
    return np.asarray(Image.open(path))


def test_the_databar_is_cut_off_and_names_are_kept(folder: Path, tmp_path: Path) -> None:
    for i in (1, 2, 10):
        save(folder / f"a{i}.png", with_databar(texture(i)))
    series = prepare_series(folder, tmp_path / "p", OPTIONS)
    assert series.names == ("a1.png", "a2.png", "a10.png")
    assert {f.crop_px for f in series.frames} == {(0, 0, 200, 136)}
    for name, i in zip(series.names, (1, 2, 10), strict=True):
        np.testing.assert_array_equal(pixels(tmp_path / "p/images" / name), texture(i)[:136])


def test_without_a_databar_nothing_is_cut_and_a_png_is_copied_byte_for_byte(
    folder: Path, tmp_path: Path
) -> None:
    for i in range(3):
        save(folder / f"{i}.png", texture(i))
    series = prepare_series(folder, tmp_path / "p", OPTIONS)
    assert series.frames[0].crop_px == (0, 0, 200, 160)
    copied = (tmp_path / "p/images/0.png").read_bytes()
    assert copied == (folder / "0.png").read_bytes()


def test_a_jpeg_is_copied_byte_for_byte_or_becomes_a_png(folder: Path, tmp_path: Path) -> None:
    for i in range(3):
        save(folder / f"plain/{i}.jpg", texture(i), quality=90)
        save(folder / f"bar/{i}.jpg", with_databar(texture(i)), quality=95)
    plain = prepare_series(folder / "plain", tmp_path / "p", OPTIONS)
    assert plain.names == ("0.jpg", "1.jpg", "2.jpg")
    copied = (tmp_path / "p/images/0.jpg").read_bytes()
    assert copied == (folder / "plain/0.jpg").read_bytes()
    bar = prepare_series(folder / "bar", tmp_path / "q", OPTIONS)
    assert bar.names == ("0.png", "1.png", "2.png")
    assert bar.frames[0].height_px == 136


@pytest.mark.parametrize("dtype", [np.uint16, np.uint32, np.float32])
def test_deep_images_are_reduced_by_robust_percentiles(
    folder: Path, tmp_path: Path, dtype: type
) -> None:
    for i in range(3):
        deep = (texture(i).astype(np.float64) * 10 + 300).astype(dtype)
        deep[3, 3] = 60_000  # a hot pixel must not take the range
        save(folder / f"{i}.tif", deep)
    prepare_series(folder, tmp_path / "p", OPTIONS)
    for i in range(3):
        out = pixels(tmp_path / f"p/images/{i}.tif").astype(float)
        assert out.dtype == np.float64
        assert np.corrcoef(out[5:].ravel(), texture(i)[5:].astype(float).ravel())[0, 1] > 0.99
        assert out.std() > 30


def test_grey_stored_as_rgb_and_rgba_comes_out_unchanged(folder: Path, tmp_path: Path) -> None:
    for i in range(3):
        grey = texture(i)
        alpha = np.full_like(grey, 255)
        save(folder / f"{i}.png", np.dstack([grey, grey, grey, alpha]))
        other = np.dstack([texture(i + 10)] * 3)
        save(folder / f"{i}.tif", other, photometric="rgb", compression="lzw")
    prepare_series(folder, tmp_path / "p", OPTIONS)
    for i in range(3):
        np.testing.assert_array_equal(pixels(tmp_path / f"p/images/{i}.png"), texture(i))
        np.testing.assert_array_equal(pixels(tmp_path / f"p/images/{i}.tif"), texture(i + 10))


@pytest.mark.parametrize(
    "options",
    [
        {"compression": "lzw"},
        {"compression": "zlib", "predictor": True},
        {"byteorder": ">"},
        {"bigtiff": True},
        {"photometric": "miniswhite"},
        {"rowsperstrip": 7},
        {"tile": (64, 64)},
    ],
    ids=lambda value: next(iter(value)),
)
def test_every_flavour_of_tiff_gives_the_same_pixels(
    folder: Path, tmp_path: Path, options: dict[str, object]
) -> None:
    for i in range(3):
        stored = 255 - texture(i) if "photometric" in options else texture(i)
        save(folder / f"{i}.tif", stored, **options)
    prepare_series(folder, tmp_path / "p", OPTIONS)
    np.testing.assert_array_equal(pixels(tmp_path / "p/images/1.tif"), texture(1))


def test_of_a_multi_page_tiff_the_first_full_size_page_is_taken(
    folder: Path, tmp_path: Path
) -> None:
    import tifffile

    for i in range(3):
        with tifffile.TiffWriter(folder / f"{i}.tif") as tiff:
            tiff.write(texture(i)[::4, ::4], subfiletype=1)
            tiff.write(texture(i))
            tiff.write(texture(99))
    series = prepare_series(folder, tmp_path / "p", OPTIONS)
    assert (series.frames[0].width_px, series.frames[0].height_px) == (200, 160)
    np.testing.assert_array_equal(pixels(tmp_path / "p/images/0.tif"), texture(0))


def test_series_json_round_trips_exactly(tmp_path: Path) -> None:
    metadata = SemMetadata(
        pixel_size_um=0.1 / 3, tilt_rad=-0.2, stage_xyz_um=(1.0, 2.5, -3.0), tilt_corrected=False,
        instrument="Ä µ", displacement_um=0.0225, source={"tilt_rad": "x"},
    )  # fmt: skip
    frame = SemFrame(
        name="a b/ü.png", width_px=3, height_px=2, source_path="/x", crop_px=(0, 1, 2, 3),
        metadata=metadata, warnings=("w",),
    )  # fmt: skip
    series = SemSeries(frames=(frame,), pixel_size_um=1 / 7, pixel_size_source="s", warnings=("v",))
    write_series(series, tmp_path / "series.json")
    assert asdict(read_series(tmp_path / "series.json")) == asdict(series)


def test_outputs_of_an_earlier_run_go_but_other_files_stay(folder: Path, tmp_path: Path) -> None:
    for i in range(4):
        save(folder / f"s/{i}.png", texture(i))
    prepare_series(folder, tmp_path / "p", OPTIONS)
    (tmp_path / "p/images/foreign.txt").write_text("keep")
    (folder / "s/3.png").rename(folder / "3.png")
    series = prepare_series(folder, tmp_path / "p", OPTIONS)
    left = {
        p.relative_to(tmp_path / "p/images").as_posix()
        for p in (tmp_path / "p/images").rglob("*")
        if p.is_file()
    }
    assert left == {*series.names, "foreign.txt"}


def test_a_second_run_of_the_same_series_changes_no_byte(folder: Path, tmp_path: Path) -> None:
    for i in range(3):
        save(folder / f"{i}.tif", with_databar(texture(i)))
    prepare_series(folder, tmp_path / "p", OPTIONS)
    before = {p: p.read_bytes() for p in (tmp_path / "p").rglob("*") if p.is_file()}
    prepare_series(folder, tmp_path / "p", OPTIONS)
    assert before == {p: p.read_bytes() for p in (tmp_path / "p").rglob("*") if p.is_file()}


def test_the_originals_are_untouched(folder: Path, tmp_path: Path) -> None:
    for i in range(3):
        save(folder / f"{i}.png", with_databar(texture(i)))
    before = {p: (p.read_bytes(), p.stat().st_mtime_ns) for p in folder.iterdir()}
    prepare_series(folder, tmp_path / "p", OPTIONS)
    assert before == {p: (p.read_bytes(), p.stat().st_mtime_ns) for p in folder.iterdir()}


def test_a_crop_overrides_the_databar(folder: Path, tmp_path: Path) -> None:
    for i in range(3):
        save(folder / f"{i}.png", with_databar(texture(i)))
    series = prepare_series(folder, tmp_path / "p", replace(OPTIONS, crop=(10, 20, 110, 90)))
    assert series.frames[0].crop_px == (10, 20, 110, 90)
    np.testing.assert_array_equal(pixels(tmp_path / "p/images/0.png"), texture(0)[20:90, 10:110])


@pytest.mark.parametrize("crop", [(5, 5, 5, 50), (50, 0, 10, 40), (-1, 0, 40, 40)])
def test_an_empty_or_reversed_crop_is_a_usage_error(
    folder: Path, tmp_path: Path, crop: tuple[int, int, int, int]
) -> None:
    with pytest.raises(UsageError, match="x0 y0 x1 y1"):
        prepare_series(folder, tmp_path / "p", replace(OPTIONS, crop=crop))


def test_given_masks_are_cut_like_their_images(folder: Path, tmp_path: Path) -> None:
    mask = np.zeros((160, 200), np.uint8)
    mask[30:100, 40:90] = 255
    for i in range(3):
        save(folder / f"{i}.tif", with_databar(texture(i)))
    save(folder / "masks/1.tif.png", mask)
    series = prepare_series(folder, tmp_path / "p", OPTIONS)
    assert len(series.frames) == 3
    np.testing.assert_array_equal(pixels(tmp_path / "p/masks/1.tif.png"), mask[:136])
    assert [p.name for p in (tmp_path / "p/masks").iterdir()] == ["1.tif.png"]


def test_two_images_that_would_get_one_name_are_refused(folder: Path, tmp_path: Path) -> None:
    for i in range(3):
        save(folder / f"{i}.png", with_databar(texture(i)))
    save(folder / "1.jpg", with_databar(texture(1)), quality=95)
    with pytest.raises(InputError, match=r"both 1\.jpg and 1\.png would be prepared as 1\.png"):
        prepare_series(folder, tmp_path / "p", OPTIONS)


@pytest.mark.parametrize(
    ("count", "sentence"),
    [(0, "no images in"), (1, "only 1 image "), (2, "only 2 images .* one-parameter family")],
)
def test_fewer_than_three_images_are_refused_in_one_sentence(
    folder: Path, tmp_path: Path, count: int, sentence: str
) -> None:
    for i in range(count):
        save(folder / f"{i}.png", texture(i))
    with pytest.raises(InputError, match=sentence):
        prepare_series(folder, tmp_path / "p", OPTIONS)


def test_a_path_that_is_no_folder_is_a_usage_error(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="does not exist"):
        prepare_series(folder / "none", tmp_path / "p", OPTIONS)
    file = save(folder / "0.png", texture(0))
    with pytest.raises(UsageError, match="is not a folder"):
        prepare_series(file, tmp_path / "p", OPTIONS)


def test_the_originals_folder_as_output_is_refused(tmp_path: Path) -> None:
    for i in range(3):
        save(tmp_path / f"p/images/{i}.png", with_databar(texture(i)))
    with pytest.raises(UsageError, match="prepared images are written"):
        prepare_series(tmp_path / "p/images", tmp_path / "p", OPTIONS)


def test_progress_counts_up_to_the_total(folder: Path, tmp_path: Path) -> None:
    for i in range(4):
        save(folder / f"{i}.png", texture(i))
    seen: list[tuple[int, int]] = []
    prepare_series(folder, tmp_path / "p", OPTIONS, progress=lambda n, m: seen.append((n, m)))
    assert seen[-1] == (8, 8)
    assert [n for n, _ in seen] == sorted(n for n, _ in seen)


@pytest.mark.data
@pytest.mark.skipif(not DATA.is_dir(), reason="needs the development data")
@pytest.mark.parametrize(
    ("series", "crop"),
    [
        ("synth_pollen/images", (0, 0, 1024, 708)),
        ("synth_nickel/images", (0, 0, 1024, 708)),
        ("synth_spore/images", (0, 0, 1024, 708)),
        ("sem_quartz3", (0, 0, 1200, 1200)),
        ("sem_pot1", (0, 0, 768, 715)),
        ("hotel/images", (0, 0, 512, 480)),
        ("temple_ring", (0, 0, 640, 480)),
    ],
)
def test_databars_are_found_to_the_row_and_none_invented(
    series: str, crop: tuple[int, int, int, int], tmp_path: Path
) -> None:
    result = prepare_series(DATA / series, tmp_path / "p", OPTIONS)
    assert {frame.crop_px for frame in result.frames} == {crop}
    assert not [w for frame in result.frames for w in frame.warnings]
