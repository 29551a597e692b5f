"""Foreign headers are hostile: the targets of scripts/fuzz_headers.py on a few hundred inputs each.

The script runs for as long as one likes, guided by coverage; what it found is a test here.
"""

from __future__ import annotations

import importlib.util
import random
import struct
import sys
from pathlib import Path
from types import ModuleType

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from semsfm_colmap.errors import UsageError
from semsfm_colmap.ingest.files.header import ImageHeader
from semsfm_colmap.ingest.metadata.registry import read_tags
from semsfm_colmap.ingest.series.table import read_series_table
from tests.ingest import vendor_files as vendor

SCRIPT = Path(__file__).parents[3] / "scripts/fuzz_headers.py"


def load_script() -> ModuleType:
    spec = importlib.util.spec_from_file_location("fuzz_headers", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["fuzz_headers"] = module
    spec.loader.exec_module(module)
    return module


fuzz = load_script()
HEADER = ImageHeader(format="tiff", width=1024, height=943, bits=8, channels=1)
SEEDS = {
    "zeiss": [vendor.zeiss(), vendor.zeiss(pixel_nm=None, display_nm=5.0)],
    "fei": [vendor.fei(), vendor.fei(drop=("Beam", "Stage"))],
    "fei_xml": [
        b"<Metadata><BinaryResult><PixelSize><X>2e-8</X></PixelSize></BinaryResult>"
        b"<StageSettings><StagePosition><Tilt><Alpha>0.5</Alpha></Tilt></StagePosition>"
        b"</StageSettings><ScanSettings><ScanSize><Width>1024</Width><Height>884</Height>"
        b"</ScanSize></ScanSettings></Metadata>"
    ],
    "tescan": [vendor.tescan_tag()],
    "jeol": [fuzz.JEOL],
    "sidecar": [vendor.hitachi().encode(), fuzz.JEOL, vendor.tescan_hdr().encode()],
    "table": [fuzz.TABLE],
    "stack": [fuzz.tiny_stack()],
    "mdoc": [fuzz.MDOC, fuzz.ANGLES],
    "file": [fuzz.tiny_tiff(), *fuzz.tiny_others()],
}


@pytest.mark.parametrize("target", sorted(SEEDS))
def test_mutated_headers_do_no_harm(target: str) -> None:
    rng = random.Random(1)
    for _ in range(300):
        fuzz.TARGETS[target](fuzz.mutate(rng.choice(SEEDS[target]), SEEDS[target], rng))


@pytest.mark.parametrize("target", sorted(SEEDS))
@settings(
    max_examples=40,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(data=st.data())
def test_arbitrary_bytes_and_spliced_headers_do_no_harm(target: str, data: st.DataObject) -> None:
    seed = data.draw(st.sampled_from(SEEDS[target]))
    at = data.draw(st.integers(0, len(seed)))
    inserted = data.draw(st.binary(max_size=200))
    skipped = data.draw(st.integers(0, 50))
    fuzz.TARGETS[target](seed[:at] + inserted + seed[at + skipped :])


# What the fuzzers found.


def test_a_raster_of_less_than_a_pixel_divides_by_nothing() -> None:
    tag = b"[Scan]\rPixelWidth=2e-8\r[Image]\rResolutionX=0.5\rResolutionY=884\r"
    reading = read_tags({vendor.FEI_HELIOS: tag}, HEADER)
    assert reading is not None
    assert reading.metadata.pixel_size_um == pytest.approx(0.02)
    lines = b"$CM_PIXEL_SIZE 25nm\n$CM_FULL_SIZE .1 .1\n"
    reading = read_tags({270: lines}, HEADER)
    assert reading is not None
    assert reading.metadata.pixel_size_um == pytest.approx(0.025)


def test_denormal_numbers_do_not_overflow_when_divided_by() -> None:
    tag = b"[EBeam]\rHFW=1e-320\r[Image]\rMagCanvasRealWidth=0.3\r"
    reading = read_tags({vendor.FEI_HELIOS: tag}, HEADER)
    assert reading is not None
    assert reading.metadata.magnification is None


def test_a_table_may_name_an_image_dot(tmp_path: Path) -> None:
    path = tmp_path / "s.csv"
    path.write_text("image,tilt_deg\n.,1\n..,2\n/,3\n")
    assert read_series_table(path).match(["a.tif", "b/c.tif"]) == {}


def test_line_breaks_in_a_table_stay_out_of_messages(tmp_path: Path) -> None:
    path = tmp_path / "s.csv"
    for text in ('"ima\nge",b\n1,2\n', '"image","a\nb"\nx,1\n', 'image\n"a\nb"\n"a\nb"\n'):
        path.write_text(text)
        try:
            sentences = read_series_table(path).warnings
        except UsageError as error:
            sentences = (str(error),)
        assert sentences
        for sentence in sentences:
            assert "\n" not in sentence


def test_escape_sequences_of_a_header_do_not_reach_the_terminal() -> None:
    tag = b"[System]\rSystemType=Q\x1b[2Juanta\x07\r[Scan]\rPixelWidth=2e-8\r"
    reading = read_tags({vendor.FEI_HELIOS: tag}, HEADER)
    assert reading is not None
    assert reading.metadata.instrument == "Q [2Juanta"
    xml = b"<a>\x1b[31m</b>"
    reading = read_tags({vendor.FEI_XML: xml}, HEADER)
    assert reading is not None
    assert all(warning.isprintable() for warning in reading.warnings)


def test_a_tiff_whose_directories_form_a_ring_ends(tmp_path: Path) -> None:
    entries = [(256, 4, 1, 4), (257, 4, 1, 4), (258, 3, 1, 8), (259, 3, 1, 1), (262, 3, 1, 1),
               (273, 4, 1, 8), (277, 3, 1, 1), (278, 4, 1, 4), (279, 4, 1, 16)]  # fmt: skip
    directory = struct.pack("<H", len(entries)) + b"".join(
        struct.pack("<HHII", *entry) for entry in entries
    )
    content = b"II*\x00" + struct.pack("<I", 24) + bytes(range(16)) + directory
    fuzz.TARGETS["file"](content + struct.pack("<I", 24))


def test_mutation_changes_inputs_and_keeps_them_short() -> None:
    rng = random.Random(0)
    seed = SEEDS["fei"][0]
    changed = [fuzz.mutate(seed, SEEDS["fei"], rng) for _ in range(50)]
    assert sum(data != seed for data in changed) > 40
    assert max(len(data) for data in changed) <= fuzz.MAX_INPUT


def test_the_script_finds_what_is_broken(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken(data: bytes) -> None:
        assert b"nan" not in data

    monkeypatch.setitem(fuzz.TARGETS, "fei", broken)
    monkeypatch.setattr(fuzz.resource, "setrlimit", lambda *_: None)
    assert fuzz.fuzz_by_mutation("fei", 30.0, SEEDS["fei"], tmp_path) == 1
    assert "AssertionError" in capsys.readouterr().out
    (found,) = tmp_path.iterdir()
    assert b"nan" in found.read_bytes()
