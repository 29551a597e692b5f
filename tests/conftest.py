from __future__ import annotations

from pathlib import Path

import pytest

from semsfm_colmap.config import Config
from semsfm_colmap.pipeline.runner import reconstruct
from semsfm_colmap.synthetic.options import SynthesizeOptions
from semsfm_colmap.synthetic.series import synthesize

DATA = Path(__file__).parents[1] / ".." / "shared" / "data"
CASES = DATA.parent / "cases"


@pytest.fixture(scope="session")
def data_path() -> Path:
    """The development data beside the repository; tests that need it are marked `data`."""
    if not DATA.is_dir():
        pytest.skip("the development data are not there")
    return DATA


@pytest.fixture(scope="session")
def cases_path() -> Path:
    """Small inputs that came out wrong once, beside the data; tests of them are marked `data`."""
    if not CASES.is_dir():
        pytest.skip("the cases are not there")
    return CASES


SMALL = SynthesizeOptions(
    scene="grain",
    num_images=7,
    step_deg=5.0,
    width_px=420,
    height_px=360,
    databar_rows=30,
    supersampling=1,
    mesh_edge_px=3.0,
    image_format="tif",
)


@pytest.fixture(scope="session")
def small_series(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Seven small TIFFs of a spiny grain with truth beside them."""
    return synthesize(tmp_path_factory.mktemp("small"), SMALL).parent


@pytest.fixture(scope="session")
def small_project(small_series: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The project made from them; tests that change it copy it first."""
    project = tmp_path_factory.mktemp("project") / "p"
    reconstruct(small_series / "images", project, Config())
    return project


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """An empty image folder."""
    path = tmp_path / "images_in"
    path.mkdir()
    return path
