import numpy as np
import pytest

from semsfm_colmap.report.world_statistics import world_statistics
from tests.report.series import SCALE, make_inputs, make_reconstruction


def world(**changes):
    return world_statistics(make_inputs(make_reconstruction(np.arange(5) * 4.0, **changes)))


def test_the_pixel_size_is_that_of_the_model():
    stated = world()
    assert stated.pixel_size_nm == pytest.approx(50.0)
    assert stated.pixel_size_source == "test chart"
    assert stated.median_scale_px_per_world == pytest.approx(SCALE)


def test_a_model_in_pixels_has_no_pixel_size():
    stated = world(world_unit="px", pixel_size_um=None, pixel_size_source="none")
    assert stated.unit == "px"
    assert stated.pixel_size_nm is None


def test_a_model_in_micrometres_without_a_stated_pixel_size_has_it_from_its_scale():
    assert world(pixel_size_um=None).pixel_size_nm == pytest.approx(1000.0 / SCALE)
