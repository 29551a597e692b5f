from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from semsfm_colmap.ingest.files.drawn_colour import drawn_colour
from semsfm_colmap.ingest.files.raster import read_header, read_pixels
from semsfm_colmap.ingest.frame.databar import agree_on_databar, find_databar, looks_drawn
from semsfm_colmap.ingest.frame.overlay import ConstantPixels, find_overlay
from semsfm_colmap.ingest.frame.scale_bar import find_scale_bar
from semsfm_colmap.ingest.masks.combine import grown
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.ingest.prepare import prepare_series
from tests.ingest.conftest import DATA, save, texture, with_databar


@pytest.mark.parametrize("background", [0, 40, 255])
@pytest.mark.parametrize("line", [True, False])
@pytest.mark.parametrize("rows", [14, 24, 50])
def test_the_databar_is_found_to_the_row(background: int, line: bool, rows: int) -> None:
    if rows < 24:
        image = with_databar(texture(1), 24, background=background, line=line)[: 160 - 24 + rows]
        expected = 136
    else:
        image = with_databar(texture(1), rows, background=background, line=line)
        expected = 160 - rows
    assert find_databar(image) == expected


def test_a_databar_that_floats_above_the_bottom_is_found() -> None:
    image = with_databar(texture(1), background=255)
    image[-1] = texture(1)[-1]
    image[136:, 0] = texture(1)[136:, 0]
    assert find_databar(image) == 136


def test_a_databar_in_the_ends_of_16_bits_is_found() -> None:
    image = texture(1).astype(np.uint16) * 12
    bar = with_databar(texture(1))[136:].astype(np.uint16) * 257
    image[136:] = bar
    assert find_databar(image) == 136


@pytest.mark.parametrize("quality", [75, 90, 98])
def test_a_databar_survives_jpeg(tmp_path: Path, quality: int) -> None:
    path = save(tmp_path / "a.jpg", with_databar(texture(1)), quality=quality)
    raw = read_pixels(path, read_header(path, 10**9))
    assert find_databar(raw.pixels, lossy=True) == 136


def test_no_databar_is_invented_in_texture() -> None:
    for seed in range(20):
        assert find_databar(texture(seed)) is None


def test_a_specimen_on_clipped_black_is_no_databar() -> None:
    rows, columns = np.indices((160, 200))
    specimen = texture(1) * ((rows - 70) ** 2 + (columns - 100) ** 2 < 55**2)
    assert find_databar(specimen.astype(np.uint8)) is None
    standing = texture(1) * (abs(columns - 100) < 40 - rows // 8)  # reaches the bottom
    assert find_databar(standing.astype(np.uint8)) is None


def test_black_padding_without_writing_is_no_databar() -> None:
    image = texture(1)
    image[140:] = 0
    assert find_databar(image) is None


def test_a_databar_below_a_clipped_black_background_is_found_by_its_line() -> None:
    rows, columns = np.indices((160, 200))
    specimen = texture(1) * ((rows - 70) ** 2 + (columns - 100) ** 2 < 55**2)
    assert find_databar(with_databar(specimen.astype(np.uint8))) == 136


@pytest.mark.parametrize("shape", [(1, 1), (3, 300), (300, 3), (20, 20)])
def test_tiny_images_have_no_databar(shape: tuple[int, int]) -> None:
    assert find_databar(np.zeros(shape, np.uint8)) is None


def test_frames_vote_on_the_databar() -> None:
    assert agree_on_databar([136, 136, None, 140]) == 136
    assert agree_on_databar([None, None, None, 136]) is None
    assert agree_on_databar([136, None]) == 136
    assert agree_on_databar([]) is None


def test_a_frame_whose_databar_is_hidden_is_cut_like_the_others(
    folder: Path, tmp_path: Path
) -> None:
    for i in range(4):
        image = with_databar(texture(i))
        if i == 2:
            image[130:140] = texture(9)[130:140]  # something over the edge
            image[150:] = texture(8)[150:]
        save(folder / f"{i}.png", image)
    series = prepare_series(folder, tmp_path / "p", IngestOptions())
    assert {frame.crop_px for frame in series.frames} == {(0, 0, 200, 136)}


def test_a_known_height_is_believed_only_where_the_rows_look_drawn() -> None:
    assert looks_drawn(with_databar(texture(1)), 136)
    assert not looks_drawn(texture(1), 136)
    assert not looks_drawn(with_databar(texture(1)), 120)


# Writing over the image.


def constant(images: list[np.ndarray], *, lossy: bool = False) -> ConstantPixels:
    frames = ConstantPixels()
    for image in images:
        frames.add(image, lossy=lossy)
    return frames


def stamped(image: np.ndarray) -> np.ndarray:
    out = image.copy()
    out[20:24, 15:75] = 255  # a scale bar
    out[30:40, 20:70:6] = 255  # a label
    return out


def test_burnt_in_writing_is_found_where_it_is() -> None:
    overlay = find_overlay(constant([stamped(texture(i)) for i in range(6)]))
    assert overlay is not None
    drawn = stamped(np.zeros((160, 200), np.uint8)) > 0
    assert overlay.writing[drawn].all()
    grown = np.zeros_like(drawn)
    grown[12:50, 5:85] = True
    assert not overlay.writing[~grown].any()
    assert overlay.databar_row is None


def test_no_writing_is_invented() -> None:
    assert find_overlay(constant([texture(i) for i in range(6)])) is None


def test_saturated_and_clipped_areas_are_no_writing() -> None:
    rows, columns = np.indices((160, 200))
    glow = 260 * np.exp(-((rows - 50) ** 2 + (columns - 60) ** 2) / 800.0)
    images = [
        np.clip(texture(i).astype(float) - 60 + glow, 0, 255).astype(np.uint8) for i in range(6)
    ]
    assert (np.min(images, axis=0) == 255).sum() > 50  # constant over the frames
    assert find_overlay(constant(images)) is None


def test_copies_of_one_frame_tell_nothing() -> None:
    assert find_overlay(constant([stamped(texture(0))] * 6)) is None


def test_few_frames_tell_nothing() -> None:
    assert find_overlay(constant([stamped(texture(i)) for i in range(3)])) is None


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


def test_a_databar_without_edge_on_clipped_black_is_found_from_many_frames(
    folder: Path, tmp_path: Path
) -> None:
    rows, columns = np.indices((160, 200))
    disc = (rows - 70) ** 2 + (columns - 100) ** 2 < 50**2
    for i in range(6):
        image = with_databar((texture(i) * disc).astype(np.uint8), line=False)
        assert find_databar(image) is None  # one frame cannot tell
        save(folder / f"{i}.png", image)
    series = prepare_series(folder, tmp_path / "p", IngestOptions())
    (crop,) = {frame.crop_px for frame in series.frames}
    assert 136 <= crop[3] <= 142  # above the first writing, below the specimen


# Colour.


def in_colour(image: np.ndarray, colour: tuple[int, int, int] = (255, 230, 0)) -> np.ndarray:
    """Grey stored as RGB with an annotation in one colour: an arrow, a frame, a label."""
    out = np.repeat(image[..., None], 3, axis=2)
    out[30:33, 40:120] = colour
    out[20:60, 150:152] = out[20:60, 180:182] = colour
    out[20:22, 150:182] = out[58:60, 150:182] = colour
    out[40:50, 60:100:4] = colour
    return out


ANNOTATION = in_colour(np.zeros((160, 200), np.uint8)).max(axis=2) > 0


@pytest.mark.parametrize("colour", [(255, 230, 0), (0, 255, 0), (90, 20, 20), (60, 120, 255)])
def test_what_is_drawn_in_colour_is_found_in_one_image(colour: tuple[int, int, int]) -> None:
    found = drawn_colour(in_colour(texture(1), colour), lossy=False)
    assert found is not None
    np.testing.assert_array_equal(found, ANNOTATION)


@pytest.mark.parametrize("quality", [80, 95])
def test_colour_survives_jpeg(tmp_path: Path, quality: int) -> None:
    path = save(tmp_path / "a.jpg", in_colour(texture(1), (255, 0, 0)), quality=quality)
    found = read_pixels(path, read_header(path, 10**9)).coloured
    assert found is not None
    assert found[ANNOTATION].mean() > 0.6
    assert not found[~grown(grown(grown(ANNOTATION)))].any()


def test_photographs_tints_and_grey_have_nothing_drawn_in_colour() -> None:
    grey = np.repeat(texture(1)[..., None], 3, axis=2)
    assert drawn_colour(grey, lossy=False) is None
    assert drawn_colour(texture(1), lossy=False) is None
    rng = np.random.default_rng(0)
    photograph = np.clip(in_colour(texture(1)) + rng.integers(-3, 4, (160, 200, 3)), 0, 255)
    assert drawn_colour(photograph.astype(np.uint8), lossy=False) is None
    tinted = grey.astype(float)
    rows, columns = np.indices((160, 200))
    disc = (rows - 80) ** 2 + (columns - 90) ** 2 < 50**2  # coloured by hand
    tinted[disc] *= (1.0, 0.7, 0.3)
    assert drawn_colour(tinted.astype(np.uint8), lossy=False) is None
    false = np.stack([texture(1), 255 - texture(1), np.zeros_like(texture(1))], axis=2)
    assert drawn_colour(false, lossy=False) is None


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


def test_a_coloured_databar_without_exact_background_is_found(folder: Path, tmp_path: Path) -> None:
    for i in range(3):
        image = np.repeat(texture(i)[..., None], 3, axis=2)
        ramp = np.repeat(np.arange(60, 130, 7), 20).astype(np.uint8)  # in ten steps of blue
        image[136:, :, 0], image[136:, :, 1], image[136:, :, 2] = 10, ramp // 2, ramp
        image[142:150, 10:100:5] = 255
        assert find_databar(image.mean(axis=2)) is None
        save(folder / f"{i}.png", image)
    series = prepare_series(folder, tmp_path / "p", IngestOptions())
    assert {frame.crop_px for frame in series.frames} == {(0, 0, 200, 136)}
    assert not list((tmp_path / "p").glob("masks/*"))


# Scale bars.


def bar_with(length: int, *, ticks: bool = True, label: bool = False) -> np.ndarray:
    bar = np.zeros((40, 600), np.uint8)
    bar[0:2] = 200
    bar[:, 0] = bar[:, 300] = bar[:, -1] = 255
    bar[20, 300:] = 255
    first = 340
    bar[30, first : first + length] = 255
    if label:
        third = length // 3
        bar[25:36, first + third : first + length - third] = 0
        bar[26:35, first + third + 4 : first + length - third - 4 : 4] = 255
    if ticks:
        bar[26:35, first] = bar[26:35, first + length - 1] = 255
    return bar


@pytest.mark.parametrize("length", [30, 101, 200])
@pytest.mark.parametrize("label", [True, False])
def test_a_scale_bar_is_measured_between_its_ticks(length: int, label: bool) -> None:
    found = find_scale_bar(bar_with(length, label=label and length > 50))
    assert found is not None
    assert found.has_marks
    assert found.length_px == length - 1


def test_a_scale_bar_without_ticks_is_measured_from_end_to_end() -> None:
    found = find_scale_bar(bar_with(120, ticks=False))
    assert found is not None
    assert (found.has_marks, found.length_px) == (False, 120)


def test_dark_writing_on_white_is_measured_too() -> None:
    found = find_scale_bar(255 - bar_with(101))
    assert found is not None
    assert found.length_px == 100


def test_frames_and_separators_are_no_scale_bars() -> None:
    bar = bar_with(0, ticks=False)
    assert find_scale_bar(bar) is None
    assert find_scale_bar(np.zeros((40, 600), np.uint8)) is None
    assert find_scale_bar(np.zeros((3, 600), np.uint8)) is None


def test_the_scale_bar_gives_the_pixel_size_where_none_is_recorded(
    folder: Path, tmp_path: Path
) -> None:
    for i in range(3):
        save(folder / f"{i}.png", with_databar(texture(i)))
    series = prepare_series(folder, tmp_path / "p", IngestOptions(scale_bar_um=7.9))
    # with_databar draws the bar from column 110 to 189.
    assert series.pixel_size_um == pytest.approx(7.9 / 79)
    assert series.pixel_size_source == "scale bar: 7.9 um over 79 px"


def test_a_scale_bar_that_contradicts_the_header_is_said(folder: Path, tmp_path: Path) -> None:
    from tests.ingest import vendor_files as vendor

    for i in range(3):
        image = with_databar(texture(i))
        vendor.write_tiff(folder / f"{i}.tif", image, {vendor.FEI_HELIOS: vendor.fei()})
    agreed = prepare_series(folder, tmp_path / "p", IngestOptions(scale_bar_um=79 * 0.025))
    assert not agreed.frames[0].warnings
    series = prepare_series(folder, tmp_path / "p", IngestOptions(scale_bar_um=4.0))
    assert series.pixel_size_um == pytest.approx(0.025)
    assert "the scale bar of 4 um is 79 px long" in series.frames[0].warnings[0]


@pytest.mark.data
@pytest.mark.skipif(not DATA.is_dir(), reason="needs the development data")
@pytest.mark.parametrize(
    ("name", "row", "label_um", "pixel_um"),
    [
        ("synth_pollen/images/pollen_000.png", 708, 15, 0.064655),
        ("synth_nickel/images/nickel_000.png", 708, 15, 0.084711),
        ("synth_spore/images/spore_000.png", 708, 3, 0.017021),
        ("sem_metadata/zeiss_512pix.tif", 350, 0.2, 0.011649976),
        ("sem_metadata/quanta_image.tif", 884, 100, 0.441942),
        ("sem_metadata/fei_helios_16bit.tif", 442, 500, 3.3724),
    ],
)
def test_real_and_rendered_scale_bars_are_measured_to_two_pixels(
    name: str, row: int, label_um: float, pixel_um: float
) -> None:
    from semsfm_colmap.ingest.frame.databar import to_levels

    raw = read_pixels(DATA / name, read_header(DATA / name, 10**9))
    assert find_databar(raw.pixels) == row
    found = find_scale_bar(to_levels(raw.pixels)[row:])
    assert found is not None
    # FEI's Helios draws arrow heads beyond the ends: 151 px for 148.
    assert abs(found.length_px - label_um / pixel_um) <= (3 if "helios" in name else 1.5)
