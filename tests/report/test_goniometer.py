from dataclasses import replace

import numpy as np
import pytest

from semsfm_colmap.motion.goniometer import Readout, measure_goniometer
from semsfm_colmap.motion.goniometer_record import goniometer_record
from semsfm_colmap.report.figures import GONIOMETER_FIGURES, draw_figures
from semsfm_colmap.report.html import render_page
from semsfm_colmap.report.metrics import compute_metrics
from tests.report.series import make_inputs, make_reconstruction

ANGLES = np.arange(0.0, 120.0, 5.0)


def inputs_of(displacement):
    rec = make_reconstruction(ANGLES)
    readout = Readout(value=displacement)
    unread = Readout(value=np.full(len(ANGLES), np.nan))
    found = measure_goniometer(
        rec.cameras,
        np.zeros(3),
        displacement=readout,
        tilt=unread,
        covariance=1e-6 * np.eye(3 * len(ANGLES)),
    )
    record = goniometer_record(
        found,
        rec.image_names,
        readout,
        unread,
        model="m",
        displacement_source="table",
        pixel_size_um=0.05,
    )
    return make_inputs(rec, goniometer=record)


def drawn(inputs):
    figures = draw_figures(inputs, compute_metrics(inputs))
    return {figure.name: figure for figure in figures}, figures


def noisy(wrong=None):
    value = ANGLES / 150.0 + 0.001 * np.random.default_rng(0).normal(size=len(ANGLES))
    if wrong is not None:
        value[wrong] += 0.2
    return value


@pytest.mark.parametrize("wrong", [None, 5])
def test_the_section_has_the_conversion_and_its_three_figures(wrong):
    inputs = inputs_of(noisy(wrong))
    by_name, figures = drawn(inputs)
    assert all(by_name[kind.name].png is not None for kind in GONIOMETER_FIGURES)
    page = render_page(inputs, compute_metrics(inputs), figures)
    section = page.split('id="goniometer"')[1].split("</section>")[0]
    assert "° per µm" in section
    assert section.count("<img") == 3
    assert ("does not fit the others" in section) == (wrong is not None)


def test_without_displacements_the_line_is_replaced_by_its_reason():
    inputs = inputs_of(np.full(len(ANGLES), np.nan))
    by_name, figures = drawn(inputs)
    assert by_name["goniometer_line"].reason == "no displacements are known"
    page = render_page(inputs, compute_metrics(inputs), figures)
    assert "no displacements are known" in page.split('id="goniometer"')[1].split("</section>")[0]


def test_a_project_that_was_not_measured_says_so_and_draws_nothing_of_it():
    inputs = replace(inputs_of(noisy()), goniometer=None)
    by_name, figures = drawn(inputs)
    assert not [name for name in by_name if name.startswith("goniometer")]
    page = render_page(inputs, compute_metrics(inputs), figures)
    assert "Not measured" in page.split('id="goniometer"')[1].split("</section>")[0]
