"""The examples in the docstrings say what is true.

They run in a folder that holds a finished project (the ball of tests/exports: 11 images) and a
rendered series of three images with its truth.
"""

from __future__ import annotations

import doctest
import importlib
from pathlib import Path

import pytest

from semsfm_colmap.synthetic.options import SynthesizeOptions
from semsfm_colmap.synthetic.series import synthesize
from tests.exports.ball_project import write_project

MODULES = (
    "colmap.model.pinhole_reading",
    "colmap.model.sparse",
    "config",
    "evaluation.compare",
    "evaluation.truth",
    "geometry.alignment",
    "geometry.epipolar",
    "geometry.rotations",
    "metrology.sizes.request_file",
    "motion.order",
    "motion.readout",
    "pipeline.plan",
    "segmentation.transfer",
    "surface.stereo.undrift",
    "synthetic.series",
    "types",
)
SMALL = SynthesizeOptions(
    scene="field", num_images=3, width_px=64, height_px=64, databar=False, mesh_edge_px=8.0
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("examples")
    write_project(path / "project", special=False)
    synthesize(path / "field", SMALL)
    return path


@pytest.mark.parametrize("name", MODULES)
def test_the_examples_of_a_module_are_true(name, folder, monkeypatch):
    monkeypatch.chdir(folder)
    module = importlib.import_module(f"semsfm_colmap.{name}")
    done = doctest.testmod(module, optionflags=doctest.NORMALIZE_WHITESPACE)
    assert done.attempted > 0
    assert done.failed == 0
