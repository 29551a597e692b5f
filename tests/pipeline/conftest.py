from __future__ import annotations

from pathlib import Path

import pytest

from semsfm_colmap.config import Config
from semsfm_colmap.pipeline.reconstruct import reconstruct
from semsfm_colmap.synthetic.options import SynthesizeOptions
from semsfm_colmap.synthetic.series import synthesize

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
