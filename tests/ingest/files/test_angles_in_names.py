from __future__ import annotations

import math
from pathlib import Path

import pytest

from semsfm_colmap.errors import InputError
from semsfm_colmap.ingest.files.angles_in_names import angles_in_names
from semsfm_colmap.ingest.files.listing import find_images
from semsfm_colmap.ingest.inspect.inspection import inspect_images
from semsfm_colmap.ingest.options import IngestOptions
from semsfm_colmap.ingest.prepare import prepare_series
from tests.ingest.images import save, texture

ASKED = IngestOptions(tilt_from_names=True)


@pytest.mark.parametrize(
    ("names", "angles"),
    [
        (["tilt_-10", "tilt_-5", "tilt_0", "tilt_5"], [-10, -5, 0, 5]),
        (["tilt_n10", "tilt_n5", "tilt_0", "tilt_p5"], [-10, -5, 0, 5]),
        (["grain_m10.5deg", "grain_p3deg"], [-10.5, 3]),
        (["-10", "0", "+10"], [-10, 0, 10]),
        (["grain-10", "grain0", "grain+10"], [-10, 0, 10]),
        (["grain-001", "grain-002"], [1, 2]),  # a dash that separates
        (["a_00", "a_05", "a_10"], [0, 5, 10]),
        (["image", "other"], None),
    ],
)
def test_angles_are_read_with_their_signs(names: list[str], angles: list[float] | None) -> None:
    assert angles_in_names([f"{name}.tif" for name in names]) == angles


@pytest.mark.parametrize(("minus", "plus"), [("-", ""), ("-", "+"), ("n", "p"), ("m", "p")])
def test_signed_names_are_in_the_order_of_their_angles(folder: Path, minus: str, plus: str) -> None:
    names = [f"tilt_{minus}10.png", f"tilt_{minus}5.png", "tilt_0.png", f"tilt_{plus}5.png"]
    for i, name in enumerate(names):
        save(folder / name, texture(i))
    assert find_images(folder).names == tuple(names)
    series = prepare_series(folder, folder.parent / "p", ASKED)
    assert [round(math.degrees(f.metadata.tilt_rad or 0)) for f in series.frames] == [-10, -5, 0, 5]
    assert series.frames[0].metadata.source["tilt_rad"] == "names of the files"
    rows = inspect_images(folder, ASKED).rows
    assert [row.tilt_deg for row in rows] == pytest.approx([-10, -5, 0, 5])
    not_asked = prepare_series(folder, folder.parent / "q", IngestOptions())
    assert not_asked.frames[0].metadata.tilt_rad is None


def test_numbered_names_stay_in_natural_order(folder: Path) -> None:
    names = ["grain-1.png", "grain-2.png", "grain-10.png"]
    for i, name in enumerate(names):
        save(folder / name, texture(i))
    assert find_images(folder).names == tuple(names)


def test_names_without_angles_are_refused_when_asked_for(good: Path) -> None:
    save(good / "other.png", texture(7))
    with pytest.raises(InputError, match=r"other\.png does not end in an angle"):
        prepare_series(good, good.parent / "p", ASKED)
