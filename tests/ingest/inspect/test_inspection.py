from __future__ import annotations

import csv
import json
from dataclasses import replace
from math import degrees
from pathlib import Path

import cv2
import numpy as np
import pytest

from semsfm_colmap.errors import InputError
from semsfm_colmap.ingest.frame.quality import judge, measure
from semsfm_colmap.ingest.inspect.files import write_inspection_csv, write_inspection_json
from semsfm_colmap.ingest.inspect.inspection import Inspection, inspect_images
from semsfm_colmap.ingest.inspect.neighbours import drifted
from semsfm_colmap.ingest.inspect.overlap import Overlap
from semsfm_colmap.ingest.inspect.rows import InspectionRow
from semsfm_colmap.ingest.inspect.text import format_inspection
from semsfm_colmap.ingest.options import IngestOptions
from tests.ingest import vendor_files as vendor
from tests.ingest.conftest import DATA, save, texture, with_databar

OPTIONS = IngestOptions()
FIELDS = [
    "name", "width", "height", "bits", "pixel_size_um", "pixel_size_source", "tilt_deg",
    "stage_rotation_deg", "scan_rotation_deg", "working_distance_um", "beam_energy_kev",
    "magnification", "instrument", "detector", "tilt_corrected", "warnings",
]  # fmt: skip
HEIGHT, WIDTH = 300, 380
SURFACE = cv2.GaussianBlur(
    np.random.default_rng(3).normal(size=(HEIGHT, WIDTH)).astype(np.float32), (0, 0), 20
)
SURFACE *= 25 / SURFACE.std()
ALBEDO = sum(
    cv2.GaussianBlur(
        np.random.default_rng(10 + k).normal(size=(HEIGHT, WIDTH)).astype(np.float32), (0, 0), s
    ) * s * w
    for k, (s, w) in enumerate([(1.2, 60), (2.5, 60), (5, 60)])
) + 120  # fmt: skip


def view(angle_deg: float, seed: int = 0, *, depth: float = 1.0) -> np.ndarray:
    """A rough surface seen under parallel projection after a tilt about the y axis."""
    rows, columns = np.indices((HEIGHT, WIDTH), dtype=np.float32)
    angle = np.radians(angle_deg)
    x = (columns - WIDTH / 2) / np.cos(angle) - np.tan(angle) * SURFACE * depth + WIDTH / 2
    seen = cv2.remap(
        ALBEDO, x.astype(np.float32), rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT
    )
    noise = np.random.default_rng(seed).normal(0, 5, size=seen.shape)
    return np.clip(np.rint(seen + noise), 0, 255).astype(np.uint8)


def write_series(folder: Path, images: list[np.ndarray]) -> None:
    for i, image in enumerate(images):
        save(folder / f"{i}.png", image)


def answer(inspection: Inspection, question: str) -> str:
    (found,) = (a.answer for a in inspection.answers if a.question == question)
    return found


def warned(inspection: Inspection, word: str) -> list[str]:
    return [row.name for row in inspection.rows if any(word in w for w in row.warnings)]


TILTS = [-12, -8, -4, 0, 4, 8, 12]


def test_a_good_series_gets_yes_throughout(folder: Path) -> None:
    write_series(folder, [view(t, i) for i, t in enumerate(TILTS)])
    inspection = inspect_images(folder, OPTIONS)
    assert [a.answer for a in inspection.answers] == ["yes"] * 5
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


def test_drift_within_a_frame_is_found(folder: Path) -> None:
    images = [view(t, i) for i, t in enumerate(TILTS)]
    shear = np.array([[1, 0.02, 0], [0, 1, 0]], np.float32)
    images[3] = cv2.warpAffine(images[3], shear, (WIDTH, HEIGHT), borderMode=cv2.BORDER_REFLECT)
    write_series(folder, images)
    assert warned(inspect_images(folder, OPTIONS), "drifted") == ["3.png"]


SHEARS = [0.1, -0.3, 0.2, 0.4, -0.2, 0.1, -0.4, 0.3, 0.2, -0.1]
"""Percent against the frame before: noise of the fits."""


@pytest.mark.parametrize("count", [6, 11])
@pytest.mark.parametrize("frame", [0, 2, -1])
def test_the_frame_that_is_sheared_against_both_neighbours_has_drifted(
    count: int, frame: int
) -> None:
    shear = np.concatenate([[0.0], np.cumsum(SHEARS[: count - 1])]) + 3.0 * np.arange(count)
    shear[frame] -= 2.5
    names = [f"{i}" for i in range(count)]
    found = drifted(names, [1000.0] * count, [overlap_of(s) for s in np.diff(shear)])
    assert list(found) == [names[frame]]
    assert "sheared by -2." in found[names[frame]]


def test_noisy_steps_and_too_few_frames_are_no_drift() -> None:
    noisy = np.random.default_rng(1).normal(0, 0.9, 47)
    names = [f"{i}" for i in range(48)]
    assert drifted(names, [1000.0] * 48, [overlap_of(s) for s in noisy]) == {}
    assert drifted(names[:4], [1000.0] * 4, [overlap_of(s) for s in (0, 2, -2)]) == {}  # which one?


def overlap_of(shear_percent: float) -> Overlap:
    linear = np.array([[1.0, shear_percent / 100], [0.0, 1.0]])
    return Overlap(num_agreeing=40, linear=linear, shift_px=np.zeros(2), parallax_px=1.0)


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


def test_without_a_usable_image_nothing_is_called_in_order(folder: Path) -> None:
    save(folder / "0.png", np.zeros((160, 200), np.uint8))
    inspection = inspect_images(folder, OPTIONS)
    assert answer(inspection, "frames in order") == "unknown"
    assert answer(inspection, "enough images") == "no"


def test_an_empty_folder_is_an_input_error(folder: Path) -> None:
    with pytest.raises(InputError, match="no images in"):
        inspect_images(folder, OPTIONS)


def test_rows_hold_what_the_headers_say_in_degrees(folder: Path) -> None:
    for i in range(3):
        tag = vendor.fei(tilt_rad=0.1 * i)
        vendor.write_tiff(folder / f"{i}.tif", with_databar(texture(i)), {vendor.FEI_HELIOS: tag})
    (folder / "bad.png").write_bytes(b"")
    rows = {row.name: row for row in inspect_images(folder, OPTIONS).rows}
    row = rows["1.tif"]
    assert (row.width, row.height, row.bits) == (200, 160, 8)
    assert row.tilt_deg == pytest.approx(degrees(0.1))
    assert row.pixel_size_um == pytest.approx(0.025)
    assert row.pixel_size_source == "FEI 34682 [EScan] PixelWidth"
    assert (row.instrument, row.detector, row.tilt_corrected) == ("Quanta FEG", "LFD", False)
    bad = rows["bad.png"]
    assert bad.width is None
    assert "is empty" in bad.warnings[0]


def test_a_table_and_an_option_override_the_rows(folder: Path, tmp_path: Path) -> None:
    write_series(folder, [texture(i) for i in range(3)])
    table = tmp_path / "s.csv"
    table.write_text("image,tilt_deg\n0.png,1.5\n1.png,2.5\n2.png,3.5\n")
    options = IngestOptions(series_csv=table, pixel_size_um=0.1)
    rows = inspect_images(folder, options).rows
    assert [row.tilt_deg for row in rows] == pytest.approx([1.5, 2.5, 3.5])
    assert rows[0].pixel_size_source == "option pixel_size_um"


def test_a_displacement_shows_in_the_text_and_leaves_the_files_as_they_are(
    folder: Path, tmp_path: Path
) -> None:
    write_series(folder, [texture(i) for i in range(3)])
    table = tmp_path / "s.csv"
    table.write_text("image,displacement_um\n0.png,0\n1.png,0.0225\n2.png,0.045\n")
    inspection = inspect_images(folder, IngestOptions(series_csv=table))
    titles, _, first, second, _ = format_inspection(inspection).splitlines()[:5]
    assert "disp um" in titles
    assert first.split()[-2:] == ["0", "1"]
    assert second.split()[-2:] == ["0.0225", "1"]
    write_inspection_json(inspection, tmp_path / "i.json")
    assert [list(row) for row in json.loads((tmp_path / "i.json").read_text())] == [FIELDS] * 3


def test_json_holds_one_object_per_image_with_null_where_nothing_is_known(
    folder: Path, tmp_path: Path
) -> None:
    write_series(folder, [texture(i) for i in range(3)])
    write_inspection_json(inspect_images(folder, OPTIONS), tmp_path / "o/i.json")
    rows = json.loads((tmp_path / "o/i.json").read_text())
    assert [list(row) for row in rows] == [FIELDS] * 3
    assert rows[0]["name"] == "0.png"
    assert rows[0]["tilt_deg"] is None
    assert rows[0]["warnings"] == ["no microscope header"]


def test_csv_holds_one_line_per_image(folder: Path, tmp_path: Path) -> None:
    write_series(folder, [texture(i) for i in range(3)])
    save(folder / 'od"d, 3.png', texture(3))
    write_inspection_csv(inspect_images(folder, OPTIONS), tmp_path / "i.csv")
    with (tmp_path / "i.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == FIELDS
    assert [row["name"] for row in rows] == ["0.png", "1.png", "2.png", 'od"d, 3.png']
    assert (rows[0]["width"], rows[0]["tilt_deg"]) == ("200", "")


def test_the_table_leaves_out_empty_columns(folder: Path) -> None:
    write_series(folder, [texture(i) for i in range(3)])
    text = format_inspection(inspect_images(folder, OPTIONS))
    assert text.splitlines()[0].split() == ["file", "size", "bits", "!"]
    assert "all images: no microscope header" in text
    assert "enough images?" in text


def row(name: str, **more: object) -> InspectionRow:
    values: dict[str, object] = {
        "width": 1024, "height": 943, "bits": 8, "pixel_size_um": 0.441942,
        "pixel_size_source": "FEI 34682 [EScan] PixelWidth", "tilt_deg": 0.7,
        "stage_rotation_deg": -135.28, "working_distance_um": 11051.0, "beam_energy_kev": 30.0,
        "detector": "LFD", **more,
    }  # fmt: skip
    return InspectionRow(name=name, **values)  # type: ignore[arg-type]


def lines_of(rows: list[InspectionRow], width: int) -> list[str]:
    text = format_inspection(Inspection(rows=tuple(rows), answers=()), width)
    lines = text.splitlines()
    assert max(map(len, lines)) <= width
    return [line for line in lines if line]


@pytest.mark.parametrize("width", [60, 80, 100, 120, 160])
def test_what_is_too_wide_and_the_same_for_all_is_said_above_the_table(width: int) -> None:
    rows = [row(f"tilt_series_{i:03}.tif", tilt_deg=5.0 * i) for i in range(4)]
    lines = lines_of(rows, width)
    if width >= 120:
        assert lines[0].split()[:6] == ["file", "size", "bits", "um/px", "from", "tilt"]
        assert "FEI 34682 [EScan] PixelWidth" in lines[2]
    else:
        assert lines[0].startswith("all images: size 1024 x 943, bits 8")
        assert "FEI 34682 [EScan] PixelWidth" in " ".join(" ".join(lines).split())
        assert [line.split() for line in lines[-2:]] == [
            [f"tilt_series_00{i}.tif", str(5 * i)] for i in (2, 3)
        ]


def test_what_differs_and_does_not_fit_goes_into_a_second_table() -> None:
    rows = [
        row(
            f"some_folder/a_rather_long_name_of_tilt_series_{i:03}.tif", width=1000 + i, bits=8 * i,
            pixel_size_um=0.441942 + i, tilt_deg=5.123 * i, stage_rotation_deg=-135.28 * i,
            pixel_size_source=f"FEI 34682 [EScan {i}] PixelWidth", working_distance_um=11051.0 * i,
            beam_energy_kev=10.0 + i, detector=f"LFD{i}",
        )
        for i in (1, 2)
    ]  # fmt: skip
    one = lines_of(rows, 160)
    assert len(one) == 4
    two = lines_of(rows, 80)
    assert len(two) == 8
    assert two[4].split()[0] == "file"
    assert all(line.startswith("…") for line in (*two[2:4], *two[6:8]))
    assert two[0].split() + two[4].split()[1:] == one[0].split()


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


def test_copies_and_images_that_are_too_small_have_a_row_that_says_so(folder: Path) -> None:
    write_series(folder, [texture(i) for i in range(3)])
    save(folder / "copy.png", texture(1))
    save(folder / "small.png", texture(1)[:20, :20])
    inspection = inspect_images(folder, OPTIONS)
    rows = {row.name: row for row in inspection.rows}
    assert rows["1.png"].warnings == ("the pixels are those of copy.png.",) or rows[
        "copy.png"
    ].warnings == ("the pixels are those of 1.png.",)
    assert rows["small.png"].warnings[0].startswith("20 x 20 pixels are too few")
    assert len(rows) == 5
    assert inspection.answers[0].reason.startswith("3 ")


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


@pytest.mark.parametrize("place", [2, 3, 5])
def test_a_frame_out_of_order_is_found(folder: Path, place: int) -> None:
    tilts = [-15, -12, -9, -6, -3, 0, 3, 6]
    tilts.insert(place, 12)
    write_series(folder, [view(t, i) for i, t in enumerate(tilts)])
    inspection = inspect_images(folder, OPTIONS)
    assert warned(inspection, "out of order") == [f"{place}.png"]
    assert warned(inspection, "drifted") == []
    assert answer(inspection, "frames in order") == "no"


def test_uneven_steps_are_in_order(folder: Path) -> None:
    tilts = [-14, -12, -10, -4, 2, 4, 6, 12, 14]
    write_series(folder, [view(t, i) for i, t in enumerate(tilts)])
    assert warned(inspect_images(folder, OPTIONS), "out of order") == []


def turned(turn_deg: float, shear: float) -> list[Overlap]:
    """The fourth of seven frames turned, then sheared."""
    c, s = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    step = np.array([[1.0, shear], [0.0, 1.0]]) @ np.array([[c, -s], [s, c]])
    steps = [np.eye(2), np.eye(2), step, np.linalg.inv(step), np.eye(2), np.eye(2)]
    return [Overlap(num_agreeing=40, linear=m, shift_px=np.zeros(2), parallax_px=1) for m in steps]


def test_a_frame_at_another_angle_is_not_called_drifted() -> None:
    names = [f"{i}" for i in range(7)]
    overlaps = turned(0.0, 0.02)
    overlaps[3] = replace(overlaps[3], parallax_px=2.0)
    assert drifted(names, [1000.0] * 7, overlaps) == {}


@pytest.mark.parametrize("turn_deg", [0.0, 3.0, -20.0, 90.0, 180.0])
def test_a_turned_frame_has_not_drifted(turn_deg: float) -> None:
    names = [f"{i}" for i in range(7)]
    assert drifted(names, [1000.0] * 7, turned(turn_deg, 0.0)) == {}


@pytest.mark.parametrize("turn_deg", [0.0, 3.0, -20.0, 180.0])
def test_a_frame_that_is_turned_and_sheared_has_drifted(turn_deg: float) -> None:
    names = [f"{i}" for i in range(7)]
    assert list(drifted(names, [1000.0] * 7, turned(turn_deg, 0.02))) == ["3"]


def test_progress_is_told(folder: Path) -> None:
    write_series(folder, [texture(i) for i in range(3)])
    seen: list[tuple[int, int]] = []
    inspect_images(folder, OPTIONS, progress=lambda n, m: seen.append((n, m)))
    assert seen == [(1, 3), (2, 3), (3, 3)]


def test_sharpness_does_not_depend_on_noise_or_contrast() -> None:
    base = view(0, 0).astype(float)
    reference = measure(base.astype(np.uint8)).sharpness
    noisy = base + np.random.default_rng(1).normal(0, 8, size=base.shape)
    faint = 120 + 0.5 * (base - 120)
    for image in (noisy, faint):
        again = measure(np.clip(image, 0, 255).astype(np.uint8)).sharpness
        assert again == pytest.approx(reference, rel=0.25)
    blurred = measure(cv2.GaussianBlur(view(0, 0), (0, 0), 1.5)).sharpness
    assert blurred < 0.5 * reference


def test_a_single_frame_is_not_judged_against_nothing() -> None:
    assert judge([measure(view(0))]) == ([],)
    assert judge([]) == ()


@pytest.mark.data
@pytest.mark.skipif(not DATA.is_dir(), reason="needs the development data")
def test_every_file_with_vendor_metadata_has_a_row() -> None:
    inspection = inspect_images(DATA / "sem_metadata", OPTIONS)
    rows = {row.name: row for row in inspection.rows}
    assert len(rows) == 6
    assert rows["tescan-pfib_dataZeroed.tif"].stage_rotation_deg == pytest.approx(30.0)
    assert "every pixel has the value 0" in rows["scios_xml_metadata.tif"].warnings[0]
    broken = rows["quad1image_001_no_beam_scan_or_system_meta.tif"]
    assert broken.pixel_size_um == pytest.approx(0.441942)
    assert "the file is damaged" in broken.warnings[0]
    assert all(row.pixel_size_um for row in inspection.rows)


@pytest.mark.data
@pytest.mark.skipif(not DATA.is_dir(), reason="needs the development data")
@pytest.mark.parametrize("name", ["sem_pot1", "synth_nickel/images"])
def test_real_and_rendered_series_are_found_in_order(name: str) -> None:
    inspection = inspect_images(DATA / name, OPTIONS)
    assert answer(inspection, "overlapping") == "yes"
    assert answer(inspection, "enough tilt") == "yes"
    assert answer(inspection, "frames in order") == "yes"
