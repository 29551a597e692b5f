"""Every format holds the map, and readers that are not ours see its units and axes."""

from __future__ import annotations

import struct
import xml.etree.ElementTree as ET
import zipfile
from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.errors import InputError, UsageError
from semsfm_colmap.metrology.heights.files.registry import (
    FORMATS,
    read_height_map,
    write_height_map,
)
from semsfm_colmap.metrology.heights.height_map import HeightMap

FLOAT32 = ("gsf", "tif")


@pytest.fixture
def tilted() -> HeightMap:
    """Higher to the right and, more so, upward; a hole at the lower left; two unlike steps."""
    y, x = np.mgrid[0:20, 0:30].astype(float)
    z = 0.1 * x + 0.5 * y
    z[1, 2] = np.nan
    sigma = np.where(np.isfinite(z), 0.01 + 0.001 * x, np.nan)
    return HeightMap(z=z, spacing=(0.25, 0.5), unit="um", sigma=sigma)


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize("unit", ["um", "px"])
def test_a_map_comes_back_as_it_was(name, unit, tilted, tmp_path):
    height_map = replace(tilted, unit=unit)
    path = tmp_path / f"map.{name}"
    if unit == "px" and name in ("x3p", "sdf"):
        with pytest.raises(InputError, match=r"would hold metres.*gsf"):
            write_height_map(height_map, path)
        return
    write_height_map(height_map, path)
    found = read_height_map(path)
    assert found.unit == unit
    assert found.spacing == pytest.approx(height_map.spacing, rel=1e-6)
    np.testing.assert_allclose(found.z, height_map.z, rtol=1e-6 if name in FLOAT32 else 1e-8)
    if name in ("gwy", "tif"):
        np.testing.assert_allclose(found.sigma, height_map.sigma, rtol=1e-6)


def test_x3p_holds_metres_along_right_handed_axes(tilted, tmp_path):
    path = tmp_path / "map.x3p"
    write_height_map(tilted, path)
    with zipfile.ZipFile(path) as archive:
        main = ET.fromstring(archive.read("main.xml"))
        text = {e.tag.split("}")[-1]: e.text for e in main.iter()}
        axes = {
            e.tag.split("}")[-1]: e for e in main.iter() if e.tag.split("}")[-1] in ("CX", "CY")
        }
        step = {name: float(next(c.text for c in e if c.tag.split("}")[-1] == "Increment"))
                for name, e in axes.items()}  # fmt: skip
        data = np.frombuffer(archive.read(text["PointDataLink"]), dtype="<f8")
    assert step == pytest.approx({"CX": 0.25e-6, "CY": 0.5e-6})
    assert (int(text["SizeX"]), int(text["SizeY"]), int(text["SizeZ"])) == (30, 20, 1)
    # x runs fastest, then y: the second number is one step to the right, the 31st one step up
    assert data[1] - data[0] == pytest.approx(0.1e-6)
    assert data[30] - data[0] == pytest.approx(0.5e-6)


def test_sdf_holds_metres_in_a_header_of_the_standard(tilted, tmp_path):
    path = tmp_path / "map.sdf"
    write_height_map(tilted, path)
    raw = path.read_bytes()
    assert raw[:8] == b"bISO-1.0"
    # behind version, manufacturer and two dates: points, profiles, scales of x, y and z
    points, profiles, dx, dy, dz = struct.unpack_from("<HHddd", raw, 8 + 10 + 12 + 12)
    assert (points, profiles) == (30, 20)
    assert (dx, dy, dz) == pytest.approx((0.25e-6, 0.5e-6, 1.0))
    data = np.frombuffer(raw, dtype="<f8", count=600, offset=81)
    # x runs fastest, then y
    assert data[1] - data[0] == pytest.approx(0.1e-6)
    assert data[30] - data[0] == pytest.approx(0.5e-6)


def test_gsf_has_its_first_row_at_the_top(tilted, tmp_path):
    path = tmp_path / "map.gsf"
    write_height_map(tilted, path)
    raw = path.read_bytes()
    head, _, _ = raw.partition(b"\0")
    said = dict(line.split(" = ") for line in head.decode().splitlines()[1:])
    assert (said["XRes"], said["YRes"], said["XYUnits"], said["ZUnits"]) == ("30", "20", "m", "m")
    assert float(said["XReal"]) == pytest.approx(30 * 0.25e-6)
    assert float(said["YReal"]) == pytest.approx(20 * 0.5e-6)
    start = (len(head) // 4 + 1) * 4
    data = np.frombuffer(raw[start:], dtype="<f4").reshape(20, 30)
    assert data[0, 0] == pytest.approx(0.5 * 19 * 1e-6)
    assert np.isnan(data[18, 2])


def test_gwyddion_marks_holes_in_a_mask_and_keeps_sigma(tilted, tmp_path):
    from gwyfile.objects import GwyObject
    from gwyfile.util import get_datafields

    path = tmp_path / "map.gwy"
    write_height_map(tilted, path)
    content = GwyObject.fromfile(str(path))
    field = get_datafields(content)["height"]
    assert (field["xres"], field["yres"]) == (30, 20)
    assert field.xreal == pytest.approx(30 * 0.25e-6)
    assert field.si_unit_z["unitstr"] == "m"
    assert field.data[0, 0] == pytest.approx(0.5 * 19 * 1e-6)
    assert content["/0/mask"].data.sum() == content["/0/mask"].data[18, 2] == 1.0


def test_tiff_tells_other_programs_its_scale(tilted, tmp_path):
    from PIL import Image

    path = tmp_path / "map.tif"
    write_height_map(tilted, path)
    with Image.open(path) as image:
        assert image.mode == "F"
        assert image.size == (30, 20)
        assert float(image.tag_v2[282]) == pytest.approx(4.0)
        assert float(image.tag_v2[283]) == pytest.approx(2.0)
        assert "unit=um" in image.tag_v2[270]
        assert image.getpixel((0, 0)) == pytest.approx(0.5 * 19)
        image.seek(1)
        assert image.getpixel((10, 0)) == pytest.approx(0.02)


def test_xyz_is_text_that_anything_reads(tilted, tmp_path):
    path = tmp_path / "map.xyz"
    write_height_map(tilted, path)
    lines = path.read_text().splitlines()
    assert lines[0] == "# x y z um"
    assert len(lines) == 1 + 20 * 30 - 1
    assert [float(v) for v in lines[2].split()] == pytest.approx([0.25, 0.0, 0.1])


@pytest.mark.parametrize("name", FORMATS)
def test_a_damaged_file_is_named_in_one_sentence(name, tmp_path):
    path = tmp_path / f"broken.{name}"
    path.write_bytes(b"not what it says\n1 2\n")
    with pytest.raises(InputError, match=r"broken\."):
        read_height_map(path)


def test_an_unknown_format_is_refused_with_the_known_ones(tilted, tmp_path):
    with pytest.raises(UsageError, match="x3p, sdf, gsf, gwy, tif, xyz"):
        write_height_map(tilted, tmp_path / "map.sur")


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match="does not exist"):
        read_height_map(tmp_path / "none.x3p")


def test_points_off_a_grid_are_refused(tmp_path):
    path = tmp_path / "cloud.xyz"
    places = np.random.default_rng(1).uniform(size=(50, 3))
    np.savetxt(path, places, header="x y z um")
    with pytest.raises(InputError, match="not on a regular grid"):
        read_height_map(path)
