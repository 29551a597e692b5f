from __future__ import annotations

from math import radians
from pathlib import Path

import numpy as np
import pytest

from semsfm_colmap.errors import InputError
from semsfm_colmap.ingest.metadata.tilt_stack import read_stack_notes
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.ingest.prepare import prepare_series
from semsfm_colmap.ingest.series.file import read_series
from semsfm_colmap.ingest.series.tilt import tilt_prior
from semsfm_colmap.types import SemSeries
from tests.ingest.prepared import OPTIONS
from tests.ingest.stacks import textures, write_mdoc, write_stack

TILTS = [-10.0, -3.5, 3.0, 10.25]


@pytest.fixture
def stack(tmp_path: Path) -> Path:
    return write_stack(tmp_path / "a.st", textures())


def prepared(stack: Path) -> SemSeries:
    return prepare_series(stack, stack.parent / "p", OPTIONS)


def tilts_deg(series: SemSeries) -> list[float]:
    tilts = [frame.metadata.tilt_rad for frame in series.frames]
    return [float(np.degrees(tilt)) for tilt in tilts if tilt is not None]


def refused(stack: Path) -> str:
    with pytest.raises(InputError) as info:
        prepared(stack)
    assert "\n" not in str(info.value)
    return str(info.value)


def test_rawtlt_gives_the_known_tilts(stack: Path) -> None:
    text = "".join(f"{tilt:7.2f}\n" for tilt in TILTS)
    stack.with_suffix(".rawtlt").write_text(text + "\n", encoding="utf-8")
    series = prepared(stack)
    assert tilts_deg(series) == pytest.approx(TILTS)
    prior = tilt_prior(series, IngestOptions())
    assert prior is not None
    assert prior.source == "a.rawtlt"
    assert prior.axis_image_rad is None


def test_a_file_that_was_edited_is_read_again(stack: Path) -> None:
    rawtlt = stack.with_suffix(".rawtlt")
    rawtlt.write_text("1\n2\n3\n4\n", encoding="utf-8")
    assert read_stack_notes(stack, 4).tilt_deg[3] == 4.0
    rawtlt.write_text("1\n2\n3\n40\n", encoding="utf-8")
    assert read_stack_notes(stack, 4).tilt_deg[3] == 40.0
    rawtlt.unlink()
    assert read_stack_notes(stack, 4).tilt_deg == {}


def test_an_mdoc_gives_tilts_pixel_size_and_axis(tmp_path: Path) -> None:
    stack = write_stack(tmp_path / "a.st", textures(), pixel_angstrom=1.0)
    title = "PixelSpacing = 432.1\n\n[T =     Tilt axis angle = -12.5, binning = 1  spot = 8]\n"
    write_mdoc(tmp_path / "a.st.mdoc", TILTS, title)
    series = prepared(stack)
    assert tilts_deg(series) == pytest.approx(TILTS)
    assert series.pixel_size_um == pytest.approx(0.04321)
    prior = tilt_prior(series, IngestOptions())
    assert prior is not None
    # counterclockwise from the vertical with y up: 12.5 degrees clockwise is to the right
    assert prior.axis_image_rad == pytest.approx(radians(102.5))
    by_hand = tilt_prior(series, IngestOptions(tilt_axis="x"))
    assert by_hand is not None
    assert by_hand.axis_image_rad == 0.0
    back = read_series(tmp_path / "p" / "series.json")
    assert back.frames[0].metadata.tilt_axis_rad == pytest.approx(radians(102.5))


def test_blocks_of_an_mdoc_that_are_no_sections_are_passed_over(stack: Path) -> None:
    path = write_mdoc(stack.with_suffix(".mdoc"), TILTS, "[FrameSet = 0]\nPixelSpacing = 9\n")
    text = path.read_text(encoding="utf-8") + "[MontSection = 0]\nTiltAngle = 80\n"
    path.write_bytes(text.replace("\n", "\r\n").encode())
    series = prepared(stack)
    assert tilts_deg(series) == pytest.approx(TILTS)
    assert not any("PixelSpacing" in said or "but a.mdoc" in said for said in series.warnings)


def test_rawtlt_has_the_last_word_and_the_difference_is_said(stack: Path) -> None:
    write_mdoc(stack.with_suffix(".mdoc"), [tilt + 2.0 for tilt in TILTS], "PixelSpacing = 200\n")
    text = "\n".join(map(str, TILTS))
    stack.with_suffix(".rawtlt").write_text(text, encoding="utf-8")
    series = prepared(stack)
    assert tilts_deg(series) == pytest.approx(TILTS)
    assert any("by up to 2 degrees; the former are used" in said for said in series.warnings)
    assert series.pixel_size_um == pytest.approx(0.025)
    assert any("but a.mdoc 0.02" in said for said in series.warnings)


@pytest.mark.parametrize("count", [3, 5])
def test_rawtlt_of_another_length_is_refused(stack: Path, count: int) -> None:
    stack.with_suffix(".rawtlt").write_text("1.0\n" * count, encoding="utf-8")
    assert f"a.rawtlt has {count} angles but a.st has 4 images" in refused(stack)


def test_an_mdoc_of_another_stack_is_refused(stack: Path) -> None:
    write_mdoc(stack.with_name("a.st.mdoc"), TILTS[:3])
    assert "describes 3 images, numbers 0 to 2, but a.st has 4" in refused(stack)


@pytest.mark.parametrize("bad", ["x", "nan", "inf", "1000", "1.0 2.0"])
def test_an_angle_that_is_none_is_refused_with_its_line(stack: Path, bad: str) -> None:
    stack.with_suffix(".rawtlt").write_text(f"1\n2\n{bad}\n4\n", encoding="utf-8")
    assert "a.rawtlt, line 3: " in refused(stack)


def test_an_angle_in_an_mdoc_that_is_none_is_refused_with_its_image(stack: Path) -> None:
    write_mdoc(stack.with_suffix(".mdoc"), [0.0, 1.0, float("nan"), 2.0])
    assert "a.mdoc, image 2: 'nan' is not a number" in refused(stack)
