"""The rendered clump on its ribbon, whose actuator turns it by 171.3 degrees per um."""

import numpy as np
import pytest

from benchmarks.goniometer import (
    STAGES,
    axis_error_deg,
    hysteresis_found,
    path_correlation,
    wobble_correlation,
)
from semsfm_colmap.colmap.model.sparse import read_model
from semsfm_colmap.config import preset
from semsfm_colmap.evaluation.truth import load_truth
from semsfm_colmap.pipeline.goniometer import measure_rotation
from semsfm_colmap.pipeline.runner import run_stages

pytestmark = [pytest.mark.data, pytest.mark.slow]

FACTOR = 171.3


@pytest.fixture(scope="module")
def spore(data_path, tmp_path_factory):
    """The series, and a mapped project of it."""
    home = data_path / "synth_spore"
    project = tmp_path_factory.mktemp("spore") / "p"
    run_stages(project, preset("low"), names=STAGES, image_path=home / "images")
    return home, project


@pytest.fixture(scope="module")
def measured(spore):
    home, project = spore
    return measure_rotation(project, displacement_path=home / "displacement.csv")


def test_the_conversion_is_right_within_two_of_its_sigmas_and_a_third_of_a_percent(measured):
    found = measured.conversion_deg_per_um
    assert abs(found.value - FACTOR) < 2 * found.sigma
    assert abs(found.value - FACTOR) < 0.003 * FACTOR
    assert found.sigma < 0.001 * FACTOR
    assert measured.displacement.is_straight
    assert measured.displacement.outliers == ()


def test_axis_wobble_and_path_are_those_of_the_truth(spore, measured):
    home, project = spore
    truth, model = load_truth(home), read_model(project / "sparse" / "0")
    assert axis_error_deg(measured, truth) < 0.1
    assert wobble_correlation(measured, truth) > 0.95
    number = {name: k for k, name in enumerate(model.image_names)}
    images = np.array([number[name] for name in measured.images])
    middle = np.broadcast_to(model.points.mean(axis=0), (len(images), 3))
    centre = model.cameras.project(middle, images)
    assert path_correlation(measured, truth, centre) > 0.95


def test_two_degrees_of_hysteresis_are_found(spore):
    home, project = spore
    found, sigma = hysteresis_found(home, project, FACTOR)
    assert found == pytest.approx(2.0, abs=0.3)
    assert found == pytest.approx(2.0, abs=3 * sigma)
