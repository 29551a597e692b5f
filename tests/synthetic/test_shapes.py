import numpy as np
import pytest

from semsfm_colmap.synthetic.scenes import build_specimen
from semsfm_colmap.synthetic.scenes.base import View
from semsfm_colmap.synthetic.scenes.shapes import FINE_RELIEF, MAX_HEIGHT

VIEW = View(edge=0.02, half_width=1.7, half_height=1.3, max_tilt_rad=np.radians(32.0))


def shape(scene, seed=1):
    return build_specimen(scene, VIEW, np.random.default_rng(seed))


def within(specimen, where):
    """Vertices of the shape whose x and y satisfy a condition."""
    x, y, _ = specimen.vertices.T
    return specimen.vertices[where(np.abs(x), np.abs(y))]


def test_a_cap_lies_on_its_sphere():
    specimen = shape("cap")
    R, h = specimen.facts["radius_units"], specimen.facts["height_units"]
    rim = R * np.sin(np.radians(specimen.facts["contact_deg"]))
    cap = within(specimen, lambda x, y: np.hypot(x, y) < 0.9 * rim)
    away = np.linalg.norm(cap - [0.0, 0.0, R - h], axis=1) - R
    assert np.std(away) == pytest.approx(FINE_RELIEF, rel=0.2)
    assert abs(np.mean(away)) < 0.1 * FINE_RELIEF


def test_a_rod_lies_on_its_cylinder():
    specimen = shape("cylinder")
    R, h = specimen.facts["radius_units"], specimen.facts["height_units"]
    edge = R * np.sin(np.radians(specimen.facts["contact_deg"]))
    rod = within(specimen, lambda x, y: y < 0.9 * edge)
    away = np.hypot(rod[:, 1], rod[:, 2] - (R - h)) - R
    assert np.std(away) == pytest.approx(FINE_RELIEF, rel=0.2)
    assert abs(np.mean(away)) < 0.1 * FINE_RELIEF


def test_a_step_has_its_height():
    specimen = shape("step")
    h, half = specimen.facts["height_units"], specimen.facts["half_width_units"]
    top = within(specimen, lambda x, y: x < half - 0.05)
    plate = within(specimen, lambda x, y: x > half + 0.45)
    height = plate[:, 2].mean() - top[:, 2].mean()
    assert height == pytest.approx(h, abs=0.1 * FINE_RELIEF)


def test_a_pyramid_has_its_volume():
    specimen = shape("pyramid")
    b, h = specimen.facts["half_base_units"], specimen.facts["height_units"]
    a, c, d = (specimen.vertices[specimen.faces[:, k]] for k in range(3))
    inside = (np.abs(a[:, 0]) < b) & (np.abs(a[:, 1]) < b)
    flat = np.cross(c - a, d - a)[:, 2] / 2.0
    volume = np.abs(np.sum((flat * (a + c + d)[:, 2] / 3.0)[inside]))
    assert volume == pytest.approx(specimen.facts["volume_units3"], rel=0.01)
    assert specimen.facts["volume_units3"] == pytest.approx(4 * b * b * h / 3)


@pytest.mark.parametrize("scene", ["cap", "step", "pyramid", "cylinder"])
def test_a_shape_stands_toward_the_viewer_and_faces_him(scene):
    specimen = shape(scene)
    a, b, c = (specimen.vertices[specimen.faces[:, k]] for k in range(3))
    assert np.mean(np.cross(b - a, c - a)[:, 2] < 0.0) > 0.99
    assert -MAX_HEIGHT < specimen.vertices[:, 2].min() < -0.4
    assert specimen.vertices[:, 2].max() < 6 * FINE_RELIEF


def test_seeds_draw_other_sizes_but_for_the_step():
    assert shape("cap", 1).facts != shape("cap", 2).facts
    assert shape("step", 1).facts == shape("step", 2).facts
