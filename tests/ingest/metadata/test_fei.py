from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import DATA
from tests.ingest import vendor_files as vendor
from tests.ingest.images import texture, with_databar
from tests.ingest.metadata.reading import read


@pytest.mark.data
@pytest.mark.skipif(not DATA.is_dir(), reason="needs the development data")
def test_fei_xml_alone_gives_the_same_as_the_text_beside_it(tmp_path: Path) -> None:
    import tifffile

    source = DATA / "sem_metadata/scios_xml_metadata.tif"
    with tifffile.TiffFile(source) as tiff:
        xml = str(tiff.pages[0].tags[34683].value).encode()
    path = vendor.write_tiff(
        tmp_path / "a.tif", np.zeros((1024, 1536), np.uint8), {vendor.FEI_XML: xml}
    )
    by_text, by_xml = asdict(read(source).metadata), asdict(read(path).metadata)
    assert by_xml["source"]["tilt_rad"] == "FEI 34683 StageSettings/StagePosition/Tilt/Alpha"
    for field in set(by_text) - {"source", "magnification"}:
        expected = by_text[field]
        if isinstance(expected, float | tuple):
            assert by_xml[field] == pytest.approx(expected, rel=1e-4), field
        else:
            assert by_xml[field] == expected, field


def test_fei_angles_are_radians_and_lengths_metres(tmp_path: Path) -> None:
    image = with_databar(texture(0))
    path = vendor.write_tiff(tmp_path / "a.tif", image, {vendor.FEI_HELIOS: vendor.fei()})
    reading = read(path)
    known = reading.metadata
    assert known.pixel_size_um == pytest.approx(0.025)
    assert known.tilt_rad == 0.5
    assert known.working_distance_um == pytest.approx(11051)
    assert known.beam_energy_kev == 30
    assert reading.image_rows == 136
    assert reading.warnings == ()


def test_an_fei_tilt_in_degrees_is_refused_not_believed(tmp_path: Path) -> None:
    tag = vendor.fei(tilt_rad=52.0)
    reading = read(vendor.write_tiff(tmp_path / "a.tif", texture(0), {vendor.FEI_HELIOS: tag}))
    assert reading.metadata.tilt_rad is None
    assert "no angle in radians" in " ".join(reading.warnings)


@pytest.mark.parametrize(
    ("dropped", "missing"),
    [
        (("System",), "instrument"),
        (("Detectors",), "detector"),
        (("Scan", "EScan", "EBeam", "Beam"), "pixel size, working distance, beam energy"),
        (("Stage", "EBeam"), "stage tilt"),
    ],
)
def test_sections_missing_from_an_fei_header_are_named(
    tmp_path: Path, dropped: tuple[str, ...], missing: str
) -> None:
    tag = vendor.fei(drop=dropped)
    path = vendor.write_tiff(tmp_path / "a.tif", with_databar(texture(0)), {vendor.FEI_SFEG: tag})
    said = " ".join(read(path).warnings)
    assert "the FEI header records no " in said
    for words in missing.split(", "):
        if words == "working distance":
            continue  # still in [Stage]
        assert words in said


def test_the_beam_without_its_own_section_is_the_electron_beam(tmp_path: Path) -> None:
    tag = vendor.fei(drop=("Beam", "Scan"))
    path = vendor.write_tiff(tmp_path / "a.tif", with_databar(texture(0)), {vendor.FEI_HELIOS: tag})
    known = read(path).metadata
    assert known.pixel_size_um == pytest.approx(0.025)
    assert known.source["scan_rotation_rad"] == "FEI 34682 [EBeam] ScanRotation"
